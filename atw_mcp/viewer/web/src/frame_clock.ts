// When the frames of the video were taken, which need not be equally spaced: phones film at a rate that varies.

export class FrameClock {
  private readonly taken: number[];

  /** step: seconds of a unit of the clock; clock: when each frame was taken, null where frame f was taken at f. */
  constructor(
    private readonly step: number,
    clock: number[] | null,
  ) {
    this.taken = clock && clock.length > 1 ? clock : [0, 1];
  }

  /** Mean time from one frame to the next [s]. */
  get interval(): number {
    const last = this.taken.length - 1;
    return ((this.at(last) - this.at(0)) / last) * this.step;
  }

  /** When frame `f` was taken [s]; between two frames by interpolation, beyond them a unit a frame. */
  time(f: number): number {
    const last = this.taken.length - 1;
    const near = Math.max(0, Math.min(f, last));
    const k = Math.min(Math.floor(near), last - 1);
    return (this.at(k) + (near - k) * (this.at(k + 1) - this.at(k)) + f - near) * this.step;
  }

  /** Place in the row of frames at time `t` [s], not rounded: the inverse of `time`. */
  frame(t: number): number {
    const last = this.taken.length - 1;
    const moment = t / this.step;
    if (moment <= this.at(0)) return moment - this.at(0);
    if (moment >= this.at(last)) return last + moment - this.at(last);
    const k = this.taken.findIndex((taken) => taken > moment) - 1;
    return k + (moment - this.at(k)) / (this.at(k + 1) - this.at(k));
  }

  private at(k: number): number {
    return this.taken[k]!;
  }
}
