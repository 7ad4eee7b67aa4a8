// When each frame of the film begins, by the film's own clock, and back.

export class FrameTimes {
  readonly count: number;
  /** Mean time from one frame to the next [s]. */
  readonly interval: number;

  /** begins: when each frame begins [s], ascending. */
  constructor(private readonly begins: ArrayLike<number>) {
    this.count = begins.length;
    const last = this.count - 1;
    this.interval = last > 0 ? (begins[last]! - begins[0]!) / last : 0.04;
  }

  /** Film's time [s] at a place in the row of frames: i is where frame i begins, i + 0.5 its middle. */
  at(place: number): number {
    const i = Math.max(0, Math.min(Math.floor(place), this.count - 1));
    const begin = this.begins[i]!;
    const next = i + 1 < this.count ? this.begins[i + 1]! : begin + this.interval;
    return begin + (place - i) * (next - begin);
  }

  /** The frame that begins nearest to a time [s], as players report it of the frame that they show. */
  beginningAt(t: number): number {
    const i = this.showing(t);
    const next = this.begins[i + 1];
    return next !== undefined && next - t < t - this.begins[i]! ? i + 1 : i;
  }

  /** The frame that is shown at a time [s]. */
  showing(t: number): number {
    let low = 0;
    let high = this.count;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.begins[middle]! <= t) low = middle;
      else high = middle;
    }
    return low;
  }
}
