// Where the rollout shown is farthest from what was observed: of each object how far, and when.
import { computed } from "@preact/signals";
import { digits, moment, quantity, words } from "../format";
import { object, opened, rollout, seek } from "../state";
import "./largest_residuals.css";

interface Largest {
  object: string;
  /** [m] */
  distance: number;
  /** In standard deviations of the measurement there; NaN where unknown. */
  sigmas: number;
  /** [s] */
  time: number;
}

const largest = computed<Largest[]>(() =>
  (rollout.value?.misfits ?? [])
    .flatMap((misfit) => {
      const distances = opened.value!.floats(misfit.distance);
      const at = distances.reduce((best, d, k) => (d > (distances[best] ?? -1) ? k : best), -1);
      if (at < 0) return [];
      const [sigmas, time] = [misfit.sigmas, misfit.times].map((block) => opened.value!.floats(block)[at]!);
      return [{ object: misfit.object, distance: distances[at]!, sigmas: sigmas!, time: time! }];
    })
    .sort((a, b) => b.distance - a.distance),
);

export function LargestResiduals() {
  if (largest.value.length === 0) return null;
  return (
    <div class="largest-residuals small" role="group" aria-label="largest distance to the observation">
      <span class="soft">Largest distance to the observation</span>
      {largest.value.map((one) => (
        <button
          key={one.object}
          class="link number"
          data-object={one.object}
          data-value={one.distance}
          data-time={one.time}
          title={Number.isNaN(one.sigmas) ? undefined : `${digits(one.sigmas, 3)} standard deviations of the measurement`}
          onClick={() => {
            object.value = one.object;
            seek(one.time);
          }}
        >
          {words(one.object)} {quantity(one.distance, "m", 3)} at {moment(one.time)}
        </button>
      ))}
    </div>
  );
}
