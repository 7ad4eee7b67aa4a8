// A video element that follows the page's clock, and says which frame is really on screen.
import { signal } from "@preact/signals";
import type { FrameTimes } from "./frame_times";

/** Rates that browsers play at; outside, the film is sought frame by frame. */
const SLOWEST = 1 / 16;
const FASTEST = 16;
/** Time [s] in which a drift is corrected by another rate; a larger one is corrected by a jump. */
const CATCH_UP = 0.3;
/** Most that the rate is changed to catch up, as a part of it. */
const MOST = 0.4;

export class Player {
  /** The frame on screen; null before the first one is decoded. */
  readonly frame = signal<number | null>(null);
  private wanted = 0;
  private sought = -1;
  private request = 0;
  private ended = false;

  constructor(
    private readonly video: HTMLVideoElement,
    private readonly times: FrameTimes,
  ) {
    video.addEventListener("seeked", this.settle);
    video.addEventListener("loadeddata", this.settle);
    this.watch();
  }

  /** Show place `f` in the row of frames, moving on by `rate` frames a second; 0: at rest. */
  follow(f: number, rate: number): void {
    this.wanted = Math.max(0, Math.min(Math.round(f), this.times.count - 1));
    if (this.video.readyState === HTMLMediaElement.HAVE_NOTHING) return; // sought once there is something
    const speed = rate * this.times.interval;
    const inside = f > -0.5 && f < this.times.count - 0.5;
    if (rate > 0 && inside && speed >= SLOWEST && speed <= FASTEST) this.play(f, speed);
    else this.rest();
  }

  dispose(): void {
    this.ended = true;
    this.video.removeEventListener("seeked", this.settle);
    this.video.removeEventListener("loadeddata", this.settle);
    if ("cancelVideoFrameCallback" in this.video) this.video.cancelVideoFrameCallback(this.request);
    this.video.pause();
  }

  private play(f: number, speed: number): void {
    const video = this.video;
    // frame i is the instant i: it is on screen while the clock is nearer to it than to another
    const target = this.times.at(f + 0.5);
    if (video.paused) {
      this.sought = -1;
      video.playbackRate = speed;
      video.play().catch(() => {}); // interrupted by a pause, or refused: the film is then sought
      if (Math.abs(video.currentTime - target) > this.times.interval / 2) video.currentTime = target;
      return;
    }
    if (video.seeking) return;
    const drift = video.currentTime - target;
    if (Math.abs(drift) > CATCH_UP * MOST * speed && Math.abs(drift) > 2 * this.times.interval) {
      video.currentTime = target;
      return;
    }
    const correction = Math.abs(drift) > this.times.interval / 2 ? drift / (CATCH_UP * speed) : 0;
    const next = speed * (1 - Math.max(-MOST, Math.min(MOST, correction)));
    const kept = Math.max(SLOWEST, Math.min(FASTEST, next));
    if (Math.abs(kept / video.playbackRate - 1) > 0.02) video.playbackRate = kept;
  }

  private rest(): void {
    if (!this.video.paused) {
      this.video.pause();
      this.sought = -1;
    }
    if (!this.video.seeking && this.sought !== this.wanted) this.seek();
  }

  private seek(): void {
    this.sought = this.wanted;
    this.video.currentTime = this.times.at(this.wanted + 0.5);
  }

  private settle = (): void => {
    if (this.ended) return;
    if (this.video.paused && this.sought !== this.wanted) this.seek();
    else if (!("requestVideoFrameCallback" in this.video)) this.frame.value = this.times.showing(this.currentTime());
  };

  private currentTime(): number {
    return (this.video as HTMLVideoElement).currentTime;
  }

  /** Wait for the next frame that is shown. */
  private watch = (): void => {
    if (this.ended) return;
    if (!("requestVideoFrameCallback" in this.video)) {
      const look = () => {
        if (this.ended) return;
        if (!this.video.seeking && this.video.readyState >= 2) this.frame.value = this.times.showing(this.currentTime());
        requestAnimationFrame(look);
      };
      requestAnimationFrame(look);
      return;
    }
    this.request = this.video.requestVideoFrameCallback((_now, shown) => {
      this.frame.value = this.times.beginningAt(shown.mediaTime);
      this.watch();
    });
  };
}
