// Files for a person to take away: pictures of canvases, plots, tables of numbers.
import { render, type VNode } from "preact";

type Shown = HTMLCanvasElement | HTMLImageElement | null | undefined;

/** A button that saves what a canvas shows. canvas: drawn in this very moment, since WebGL keeps no picture. */
export function PictureButton({ name, canvas }: { name: string; canvas: () => Shown | Promise<Shown> }) {
  const take = (shown: Shown) => picture(shown, (made) => save(`${name}.png`, made));
  const press = () => {
    const shown = canvas();
    if (shown instanceof Promise) void shown.then(take);
    else take(shown);
  };
  return (
    <button class="small" title={`Save as ${name}.png`} onClick={press}>
      PNG
    </button>
  );
}

function svgText(drawing: VNode): string {
  const into = document.createElement("div");
  render(drawing, into);
  return new XMLSerializer().serializeToString(into.firstElementChild!);
}

/** A picture of a plot that is no canvas. */
export async function drawn(drawing: VNode): Promise<HTMLImageElement> {
  const image = new Image();
  image.src = `data:image/svg+xml,${encodeURIComponent(svgText(drawing))}`;
  await image.decode();
  return image;
}

/** A button that saves a plot as SVG. */
export function VectorButton({ name, drawing }: { name: string; drawing: () => VNode }) {
  const text = () => svgText(drawing());
  return (
    <button class="small" title={`Save as ${name}.svg`} onClick={() => save(`${name}.svg`, new Blob([text()], { type: "image/svg+xml" }))}>
      SVG
    </button>
  );
}

/** A button that saves a table: its header, then rows; numbers that are none are empty cells. */
export function TableButton({ name, rows }: { name: string; rows: () => (string | number)[][] }) {
  const cell = (value: string | number) =>
    typeof value === "number" ? (Number.isFinite(value) ? String(value) : "") : `"${value.replaceAll('"', '""')}"`;
  const text = () => rows().map((row) => `${row.map(cell).join(",")}\n`);
  return (
    <button class="small" title={`Save as ${name}.csv`} onClick={() => save(`${name}.csv`, new Blob(text(), { type: "text/csv" }))}>
      CSV
    </button>
  );
}

/** Lay a canvas on the page's ground: it may be clear where nothing is drawn. */
function picture(shown: Shown, done: (made: Blob) => void): void {
  if (!shown) return;
  const { width, height } = shown;
  const flat = Object.assign(document.createElement("canvas"), { width, height });
  const context = flat.getContext("2d")!;
  context.fillStyle = getComputedStyle(document.body).backgroundColor;
  context.fillRect(0, 0, width, height);
  context.drawImage(shown, 0, 0);
  flat.toBlob((made) => made && done(made));
}

function save(name: string, data: Blob): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(data);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000); // once the browser has it
}
