// Play, steps, speed, loop, and what time it is.
import { useComputed } from "@preact/signals";
import { happening, stepEvent, visibleLanes } from "../events";
import { moment } from "../format";
import { Icon, type IconName } from "../icons";
import { SPEEDS, stepFrame, togglePlay } from "../keys";
import { document, duration, filmEnd, frame, frameClock, loop, nearestFrame, playing, secondsPerFrame, seek, speed, time, timeBase } from "../state";
import "./transport.css";

const FRACTIONS: Record<number, string> = { 0.0625: "1/16", 0.125: "1/8", 0.25: "1/4", 0.5: "1/2" };

export function Transport() {
  return (
    <div class="bar transport" role="group" aria-label="transport">
      <div class="main">
        <div class="buttons">
          <Button icon="start" label="To the start (Home)" run={() => seek(0)} />
          <Button icon="previous" label="Previous event (Shift ←)" run={() => stepEvent(-1)} />
          <Button icon="back" label="One frame back (←)" run={() => stepFrame(-1)} />
          <button
            class="primary icon play"
            aria-label={playing.value ? "Pause" : "Play"}
            title={playing.value ? "Pause (Space)" : "Play (Space)"}
            disabled={duration.value === 0}
            onClick={togglePlay}
          >
            <Icon name={playing.value ? "pause" : "play"} />
          </button>
          <Button icon="forward" label="One frame forward (→)" run={() => stepFrame(1)} />
          <Button icon="next" label="Next event (Shift →)" run={() => stepEvent(1)} />
          <Button icon="end" label="To the end (End)" run={() => seek(duration.value)} />
        </div>
        <Clock />
      </div>
      <label>
        <span class="visually-hidden">speed</span>
        <select
          title="Seconds of the world in a second ([ slower, ] faster)"
          value={String(speed.value)}
          onChange={(event) => (speed.value = Number(event.currentTarget.value))}
        >
          {SPEEDS.map((s) => (
            <option key={s} value={String(s)}>
              {FRACTIONS[s] ?? s} ×
            </option>
          ))}
        </select>
      </label>
      <button
        class="icon"
        aria-label="Loop"
        title="Loop (L)"
        aria-pressed={loop.value}
        onClick={() => (loop.value = !loop.value)}
      >
        <Icon name="loop" />
      </button>
      <Now />
    </div>
  );
}

function Button({ icon, label, run }: { icon: IconName; label: string; run: () => void }) {
  return (
    <button class="quiet icon" aria-label={label.replace(/ \(.*/, "")} title={label} onClick={run}>
      <Icon name={icon} />
    </button>
  );
}

/** The time in seconds and as a frame of the video. */
function Clock() {
  const beyond = filmEnd.value !== null && nearestFrame.value > Math.round(frameClock.value.frame(filmEnd.value));
  return (
    <p class="clock number" data-time={time.value} data-frame={frame.value}>
      <b>{moment(time.value)}</b>
      <span class="soft length">of {moment(duration.value)}</span>
      {timeBase.value && (
        <span class="chip" data-time-base title="No world says yet how much time passes from frame to frame">
          {timeBase.value}
        </span>
      )}
      {filmEnd.value !== null && (
        <span class="soft">
          {beyond ? `beyond the ${document.value!.case.kind === "video" ? "video" : "data"}` : `frame ${nearestFrame.value}${lastFrame()}`}
        </span>
      )}
    </p>
  );
}

function lastFrame(): string {
  const film = document.value?.film;
  return film ? ` of ${film.frame_count - 1}` : "";
}

/** The event that is happening: the last visible one within the present frame. */
function Now() {
  const text = useComputed(() => {
    const until = time.value + 1e-6;
    const found = visibleLanes.value
      .flatMap((lane) => lane.marks)
      .filter((m) => m.event.time <= until && m.event.time > until - secondsPerFrame.value)
      .at(-1);
    return found ? happening(found.event) : "";
  });
  return (
    <p class="now small" aria-live={playing.value ? "off" : "polite"} title={text.value}>
      {text.value}
    </p>
  );
}
