// What differs between two rollouts: displaced objects, events that are gone and events that are new.
import type { ComparisonView, EventMark } from "../document";
import { comparison, happening, showEvent } from "../events";
import { moment, quantity, words } from "../format";
import { chosen, compared, document, layout, object, rolloutOf, seek } from "../state";
import { cite } from "./head";
import "./comparison.css";

export function Comparison() {
  const all = document.value!.comparisons;
  const shown = comparison.value;
  return (
    <div class="comparison">
      {(all.length > 1 || !shown) && (
        <div class="bar">
          <label>
            <span class="visually-hidden">comparison</span>
            <select
              value={shown ? String(all.indexOf(shown)) : ""}
              onChange={(event) => show(all[Number(event.currentTarget.value)]!)}
            >
              {!shown && <option value="">No stored comparison of these two rollouts: choose another</option>}
              {all.map((one, k) => (
                <option key={k} value={String(k)}>
                  {titleOf(one)}
                </option>
              ))}
            </select>
          </label>
        </div>
      )}
      {shown && <Shown view={shown} />}
    </div>
  );
}

function titleOf(view: ComparisonView): string {
  return `${rolloutOf(view.base)?.label ?? view.base} → ${rolloutOf(view.edited)?.label ?? view.edited}`;
}

function show(view: ComparisonView): void {
  chosen.value = view.base;
  compared.value = view.edited;
  if (layout.value === "one") layout.value = "ghost";
}

function Shown({ view }: { view: ComparisonView }) {
  return (
    <>
      <p class="summary">{view.summary}</p>
      <p class="soft small">
        {titleOf(view)}
        {view.evidence && (
          <>
            , evidence{" "}
            <button class="link" onClick={() => cite(view.evidence!)}>
              {view.evidence}
            </button>
          </>
        )}
      </p>
      <div class="columns">
        <DisplacedTable view={view} />
        <EventsTable view={view} />
      </div>
    </>
  );
}

function DisplacedTable({ view }: { view: ComparisonView }) {
  if (view.displaced.length === 0) return <p class="soft">No object is displaced.</p>;
  const rows = view.displaced.toSorted((a, b) => b.most - a.most);
  const most = rows[0]!.most || 1;
  return (
    <div class="scroll">
      <table>
        <caption>Displaced objects</caption>
        <thead>
          <tr>
            <th>Object</th>
            <th class="number">Greatest distance</th>
            <th>
              <span class="visually-hidden">relative to the largest</span>
            </th>
            <th class="number">At</th>
          </tr>
        </thead>
        <tbody>
          {rows.map((row) => (
            <tr
              key={row.object}
              aria-selected={object.value === row.object}
              data-object={row.object}
              data-value={row.most}
              data-time={row.time}
            >
              <td>
                <button class="link" onClick={() => (object.value = row.object)}>
                  {words(row.object)}
                </button>
              </td>
              <td class="number">{quantity(row.most, "m")}</td>
              <td class="length">
                <span class="amount" style={{ width: `${(100 * row.most) / most}%` }} />
              </td>
              <td class="number">
                <button class="link" onClick={() => (seek(row.time), (object.value = row.object))}>
                  {moment(row.time)}
                </button>
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

function EventsTable({ view }: { view: ComparisonView }) {
  const rows = [
    ...view.gone.map((event) => ({ event, change: "gone" as const, rollout: view.base })),
    ...view.new.map((event) => ({ event, change: "new" as const, rollout: view.edited })),
    ...(view.shifted ?? []).map(({ event, shift }) => ({ event, change: "shifted" as const, rollout: view.base, shift })),
  ].sort((a, b) => a.event.time - b.event.time);
  if (rows.length === 0) return <p class="soft">The same events happen in both.</p>;
  return (
    <div class="scroll">
      <table>
        <caption>
          Events: {view.gone.length} gone, {view.new.length} new
          {view.shifted?.length ? `, ${view.shifted.length} at another time` : ""}
        </caption>
        <thead>
          <tr>
            <th>Change</th>
            <th class="number">Time</th>
            <th>Event</th>
          </tr>
        </thead>
        <tbody>
          {rows.map((row, k) => (
            <EventLine key={k} {...row} />
          ))}
        </tbody>
      </table>
    </div>
  );
}

const SIGNS = { gone: "× gone", new: "+ new", shifted: "↔ kept" };

interface Line {
  event: EventMark;
  change: keyof typeof SIGNS;
  rollout: string;
  /** Of a kept event: how much later it is in the edited rollout [s]. */
  shift?: number;
}

function EventLine({ event, change, rollout, shift }: Line) {
  return (
    <tr data-change={change} data-shift={shift} data-kind={event.kind} data-time={event.time}>
      <td class="number">
        <span class={`sign ${change}`}>{SIGNS[change]}</span>
      </td>
      <td class="number">
        <button class="link" onClick={() => showEvent(event, rollout)}>
          {moment(event.time)}
        </button>
      </td>
      <td>
        {happening(event)}
        {shift !== undefined && <span class="soft">, {quantity(Math.abs(shift), "s")} {shift < 0 ? "earlier" : "later"}</span>}
      </td>
    </tr>
  );
}
