// The video of the case, with outlines of what was observed in it and of the simulated worlds.
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { ViewDocument } from "../document";
import { moment, words } from "../format";
import { Ruler, RulerButton } from "../ruler";
import { PictureButton } from "../save";
import { object, opened, other, rollout } from "../state";
import type { Opened } from "../unpack";
import { COMPARED, DASHES, OBSERVED, SHOWN } from "./film/drawing";
import { LAYERS, observedLayer, pathLayer, worldLayer } from "./film/shown";
import { Stage, type Hit } from "./film/stage";
import "./film.css";

export function Film() {
  const open = opened.value;
  if (!open) return null;
  const stage = useSignal<Stage | null>(null);
  const trouble = useSignal("");
  const hit = useSignal<(Hit & { x: number; y: number }) | null>(null);
  const measuring = useSignal(false);
  const canvas = useRef<HTMLCanvasElement>(null);
  const video = useRef<HTMLVideoElement>(null);
  useEffect(() => {
    const made = new Stage(canvas.current!, open);
    stage.value = made;
    if (!open.document.film) return () => made.dispose();
    made.attach(video.current);
    const failed = () => {
      made.attach(null);
      trouble.value = `This browser does not play the video (${why(video.current!)}).`;
    };
    video.current!.addEventListener("error", failed);
    return () => {
      video.current?.removeEventListener("error", failed);
      made.dispose();
    };
  }, [open]);
  useEffect(() => {
    trouble.value = "";
    return load(open, video.current, (message) => (trouble.value = message));
  }, [sourceOf(open.document)]);

  const doc = open.document;
  const drawn = stage.value?.drawn.value;
  const beyond = drawn?.frame === null;
  const { width, height } = stage.value?.size ?? doc.film ?? { width: 3, height: 2 };
  const at = (event: PointerEvent) => {
    const box = canvas.current!.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    const found = stage.value?.hit(x, y) ?? null;
    return found && { ...found, x, y, right: x > box.width / 2 };
  };
  const locate = (x: number, y: number) => stage.value!.metres(x, y);
  const notes = [trouble.value, doc.film ? "" : without(doc), drawn?.missing ?? ""].filter(Boolean);
  return (
    <section
      class="film panel"
      aria-label="Video"
      data-frame={drawn?.frame ?? ""}
      data-chosen={object.value ?? ""}
      data-time={drawn?.time}
      data-observed={drawn?.observed.join(" ")}
      data-simulated={drawn?.simulated.join(" ")}
    >
      <div class="bar">
        <h2>Video</h2>
        <span class="number small soft" data-beyond={beyond}>
          {beyond ? "beyond the video" : `frame ${drawn?.frame ?? 0}`}
          <span class="film-time"> · {moment(drawn?.time ?? 0)}</span>
        </span>
        <span class="push" />
        {LAYERS.map((layer) => (
          <button
            key={layer.key}
            class="small"
            aria-pressed={layer.on.value}
            title={`${layer.does} (${layer.key.toUpperCase()})`}
            onClick={() => (layer.on.value = !layer.on.value)}
          >
            {layer.title}
          </button>
        ))}
        <RulerButton on={measuring} />
        <PictureButton name={`frame ${drawn?.frame ?? 0}`} canvas={() => canvas.current} />
      </div>
      <div class="film-room">
        <div class="film-frame" style={{ "--width": width, "--height": height }} title={doc.film?.note}>
          {doc.film && <video ref={video} muted playsInline preload="auto" aria-hidden="true" tabIndex={-1} />}
          <canvas
            ref={canvas}
            class={hit.value ? "over" : ""}
            aria-label="Outlines over the video; the list of objects selects them too"
            role="img"
            onPointerMove={(event) => (hit.value = at(event))}
            onPointerLeave={() => (hit.value = null)}
            onClick={(event) => (object.value = at(event as unknown as PointerEvent)?.name ?? null)}
          />
          {measuring.value && stage.value && <Ruler locate={locate} pixels={width / (canvas.current?.clientWidth || width)} />}
          {beyond && <p class="film-beyond">beyond the video</p>}
          {hit.value && (
            <div class="film-tip small" role="tooltip" style={{ left: `${hit.value.x}px`, top: `${hit.value.y}px` }}>
              <strong>{words(hit.value.name)}</strong>
              {hit.value.lines.map((line) => (
                <div key={line}>{line}</div>
              ))}
            </div>
          )}
        </div>
      </div>
      <div class="film-legend small soft">
        {doc.observed && observedLayer.on.value && <Mark color={OBSERVED} dash={DASHES.observed} text="observed" />}
        {(worldLayer.on.value || pathLayer.on.value) && rollout.value && (
          <Mark color={SHOWN} dash={DASHES.shown} text={`simulated, ${rollout.value.label}`} />
        )}
        {(worldLayer.on.value || pathLayer.on.value) && other.value && (
          <Mark color={COMPARED} dash={DASHES.compared} text={`simulated, ${other.value.label}`} />
        )}
        {notes.map((note) => (
          <span key={note} role="status">
            {note}
          </span>
        ))}
      </div>
    </section>
  );
}

/** A piece of a line as it is drawn over the film. */
function Mark({ color, dash, text }: { color: string; dash: readonly number[]; text: string }) {
  return (
    <span class="film-mark">
      <svg width="30" height="10" aria-hidden="true">
        <rect width="30" height="10" rx="2" fill="#2a2e33" />
        <line x1="2" x2="28" y1="5" y2="5" stroke={color} stroke-width="2" stroke-dasharray={dash.join(" ")} />
      </svg>
      {text}
    </span>
  );
}

/** The film's address: of a page that changes while it is open, only a new film is loaded. */
function sourceOf(doc: ViewDocument): string {
  const film = doc.film;
  return film ? `${film.url?.slice(-99) ?? ""} ${film.mime} ${film.data?.shape[0] ?? 0} ${film.frame_count}` : "";
}

/** Load the film whole, so that every frame can be sought; returns how to let it go. */
function load(open: Opened, video: HTMLVideoElement | null, fail: (message: string) => void): () => void {
  const film = open.document.film;
  if (!film || !video) return () => {};
  let address = "";
  let gone = false;
  const take = (blob: Blob) => {
    if (gone) return;
    address = URL.createObjectURL(blob);
    video.src = address;
  };
  if (film.data) take(new Blob([open.numbers(film.data) as Uint8Array<ArrayBuffer>], { type: film.mime }));
  else if (film.url?.startsWith("data:")) video.src = film.url; // of an MCP host, which may let no blob: be played
  else if (film.url) {
    fetch(film.url)
      .then((answer) => (answer.ok ? answer.blob() : Promise.reject(new Error(`${answer.status} ${answer.statusText}`))))
      .then((blob) => take(new Blob([blob], { type: film.mime })))
      .catch((error: unknown) => fail(`The video was not loaded: ${error instanceof Error ? error.message : error}.`));
  }
  return () => {
    gone = true;
    video.removeAttribute("src");
    video.load();
    if (address) URL.revokeObjectURL(address);
  };
}

function why(video: HTMLVideoElement): string {
  const mime = opened.peek()?.document.film?.mime ?? "";
  return video.canPlayType(mime) === "" ? `it does not decode ${mime}` : (video.error?.message ?? "unknown error");
}

function without(doc: ViewDocument): string {
  return doc.missing.find((sentence) => sentence.startsWith("The video")) ?? "This case has no video.";
}
