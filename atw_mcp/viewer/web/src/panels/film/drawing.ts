// Lines and writing over the film, legible on any ground: each in its colour on a dark halo.

const DARK = "rgba(12, 12, 12, 0.78)";
export const OBSERVED = "#ffffff";
export const SHOWN = "#ff4dff";
export const COMPARED = "#ff9a4d";
/** Lengths of strokes and gaps [px of the screen]; none: a solid line. */
export const DASHES = { observed: [5, 4], shown: [], compared: [9, 5] } as const;

export interface Ink {
  color: string;
  dash: readonly number[];
  /** [px of the screen] */
  width: number;
}

/** A canvas whose units are pixels of the original frame, with centres of pixels at whole numbers. */
export class Sheet {
  private taken: [number, number, number, number][] = [];

  constructor(
    private readonly context: CanvasRenderingContext2D,
    /** Pixels of the screen in a pixel of the frame. */
    readonly scale: number,
    private readonly width: number,
    private readonly height: number,
  ) {}

  clear(ratio: number): void {
    const c = this.context;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, c.canvas.width, c.canvas.height);
    const s = this.scale * ratio;
    c.setTransform(s, 0, 0, s, 0.5 * s, 0.5 * s);
    c.lineJoin = c.lineCap = "round";
    this.taken = [];
  }

  dim(): void {
    this.context.fillStyle = "rgba(0, 0, 0, 0.55)";
    this.context.fillRect(-0.5, -0.5, this.width, this.height);
  }

  fill(path: Path2D, color: string, opacity: number): void {
    this.context.globalAlpha = opacity;
    this.context.fillStyle = color;
    this.context.fill(path, "evenodd");
    this.context.globalAlpha = 1;
  }

  stroke(path: Path2D, ink: Ink): void {
    const c = this.context;
    c.lineCap = ink.dash.length ? "butt" : "round";
    c.setLineDash(ink.dash.map((length) => length / this.scale));
    c.strokeStyle = DARK;
    c.lineWidth = (ink.width + 2.2) / this.scale;
    c.stroke(path);
    c.strokeStyle = ink.color;
    c.lineWidth = ink.width / this.scale;
    c.stroke(path);
    c.setLineDash([]);
  }

  dot(u: number, v: number, color: string): void {
    const c = this.context;
    for (const [radius, fill] of [
      [4, DARK],
      [2.6, color],
    ] as const) {
      c.fillStyle = fill;
      c.beginPath();
      c.arc(u, v, radius / this.scale, 0, 2 * Math.PI);
      c.fill();
    }
  }

  /** Write a name beside a box [px of the frame] where no other stands. */
  name(text: string, box: readonly [number, number, number, number], color: string, strong: boolean): void {
    const c = this.context;
    const size = 12 / this.scale;
    c.font = `${strong ? 700 : 500} ${size}px system-ui, sans-serif`;
    const width = c.measureText(text).width;
    const pad = 4 / this.scale;
    const [left, top, right, bottom] = box;
    const middle = (left + right) / 2;
    const places: [number, number][] = [
      [middle - width / 2, top - pad],
      [middle - width / 2, bottom + pad + 0.8 * size],
      [right + pad, (top + bottom) / 2 + 0.35 * size],
      [left - pad - width, (top + bottom) / 2 + 0.35 * size],
    ];
    const boxes = places.map(([x, y]): [number, number, number, number] => {
      const u = Math.max(1, Math.min(x, this.width - width - 2));
      const v = Math.max(size, Math.min(y, this.height - 3));
      return [u, v - 0.8 * size, u + width, v + 0.2 * size];
    });
    const best = boxes.reduce((a, b) => (this.overlap(b) < this.overlap(a) ? b : a));
    this.taken.push(best);
    c.lineWidth = 3.5 / this.scale;
    c.lineJoin = "round";
    c.strokeStyle = DARK;
    c.strokeText(text, best[0], best[3] - 0.2 * size);
    c.fillStyle = color;
    c.fillText(text, best[0], best[3] - 0.2 * size);
  }

  private overlap(a: [number, number, number, number]): number {
    return this.taken.reduce(
      (sum, b) =>
        sum + Math.max(0, Math.min(a[2], b[2]) - Math.max(a[0], b[0])) * Math.max(0, Math.min(a[3], b[3]) - Math.max(a[1], b[1])),
      0,
    );
  }
}
