// Outlines of the objects that were observed, frame by frame, in pixels of the original frames.
import type { Observed, Outlined } from "../../document";
import type { Opened } from "../../unpack";

export interface Outline {
  name: string;
  /** Corners of the polygons of an object in one frame, at centres of pixels; holes by the even-odd rule. */
  path: Path2D;
  /** Left, top, right, bottom [px]. */
  box: [number, number, number, number];
  status: string;
  confidence: number;
}

export class Outlines {
  /** Right and lower end of everything outlined [px]. */
  readonly extent: [number, number] = [1, 1];
  private readonly rows: Map<number, number>;
  private readonly firsts: Map<number, number>[];
  private readonly known = new Map<string, Outline | null>();

  constructor(
    private readonly opened: Opened,
    readonly observed: Observed,
  ) {
    this.rows = new Map([...opened.numbers(observed.frames)].map((frame, row) => [frame, row]));
    this.firsts = observed.objects.map((seen) => {
      const first = new Map<number, number>();
      opened.numbers(seen.frames).forEach((frame: number, k: number) => {
        if (!first.has(frame)) first.set(frame, k);
      });
      const points = opened.numbers(seen.points);
      for (let i = 0; i < points.length; i += 2) {
        this.extent[0] = Math.max(this.extent[0], points[i]! + 1);
        this.extent[1] = Math.max(this.extent[1], points[i + 1]! + 1);
      }
      return first;
    });
  }

  /** Whether a frame was looked at. */
  has(frame: number): boolean {
    return this.rows.has(frame);
  }

  /** Row of a frame in series over the frames that were looked at. */
  row(frame: number): number | undefined {
    return this.rows.get(frame);
  }

  /** What is seen of all objects in a frame. */
  at(frame: number): Outline[] {
    return this.observed.objects.map((_, k) => this.outline(k, frame)).filter((found) => found !== null);
  }

  private outline(k: number, frame: number): Outline | null {
    const key = `${k}:${frame}`;
    let found = this.known.get(key);
    if (found === undefined) {
      found = this.made(this.observed.objects[k]!, this.firsts[k]!.get(frame), frame);
      this.known.set(key, found);
    }
    return found;
  }

  private made(seen: Outlined, first: number | undefined, frame: number): Outline | null {
    if (first === undefined) return null;
    const points = this.opened.numbers(seen.points);
    const starts = this.opened.numbers(seen.starts);
    const frames = this.opened.numbers(seen.frames);
    const path = new Path2D();
    const box: Outline["box"] = [Infinity, Infinity, -Infinity, -Infinity];
    for (let q = first; frames[q] === frame; q++) {
      for (let p = starts[q]!; p < starts[q + 1]!; p++) {
        const x = points[2 * p]!;
        const y = points[2 * p + 1]!;
        if (p === starts[q]) path.moveTo(x, y);
        else path.lineTo(x, y);
        box[0] = Math.min(box[0], x);
        box[1] = Math.min(box[1], y);
        box[2] = Math.max(box[2], x);
        box[3] = Math.max(box[3], y);
      }
      path.closePath();
    }
    const row = this.rows.get(frame) ?? -1;
    const confidence = this.opened.numbers(seen.confidence)[row] ?? NaN;
    return { name: seen.name, path, box, status: seen.status[row] ?? "", confidence };
  }
}
