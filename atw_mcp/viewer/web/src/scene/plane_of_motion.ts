// The plane that objects move in, seen straight on.
import { Plane, Vector3 } from "three";
import type { RolloutView, WorldView } from "../document";
import type { Opened } from "../unpack";

/** A motion is flat along an axis where its variance is below this part of the greatest. */
const FLAT = 0.02;

/**
 * Unit vector along a world axis towards an eye that looks straight on the plane of motion: the floor's normal where
 * objects slide on one, else the axis along which positions vary least, else upwards.
 */
export function planeNormal(opened: Opened, world: WorldView, rollout: RolloutView | null): Vector3 {
  if (world.floor) {
    const normal = new Vector3().fromArray(world.floor.normal).normalize();
    return toAxis(normal.toArray());
  }
  if (!rollout) return new Vector3(0, 0, 1);
  const sets = [opened.floats(rollout.positions), ...rollout.deformed.map((d) => opened.floats(d.points))];
  const variance = [0, 0, 0];
  for (const values of sets) {
    const step = 3 * Math.max(1, Math.floor(values.length / 3 / 3000));
    for (let k = 0; k < 3; k++) {
      let [sum, square, count] = [0, 0, 0];
      for (let i = k; i < values.length; i += step) {
        const x = values[i]!;
        if (!Number.isFinite(x)) continue;
        sum += x;
        square += x * x;
        count++;
      }
      if (count) variance[k] = Math.max(variance[k]!, square / count - (sum / count) ** 2);
    }
  }
  const least = variance.indexOf(Math.min(...variance));
  // the plane of motion of one ball that falls is no plane: both other axes must vary
  const others = variance.filter((_, k) => k !== least);
  const flat = variance[least]! < FLAT * Math.min(...others);
  if (flat && world.planar) return toAxis([0, 1, 2].map((k) => Number(k === least)));
  return flat && least !== 2 ? toAxis([0, 1, 2].map((k) => Number(k === least))) : new Vector3(0, 0, 1);
}

/** The plane of motion: through the middle of what moves, of its starts where it was not run. */
export function planeOfMotion(opened: Opened, world: WorldView, rollout: RolloutView | null): Plane {
  const places = rollout ?? world.start;
  const values = places ? opened.floats(places.positions) : [];
  const middle = [0, 1, 2].map((k) => {
    const own = Array.from(values).filter((x, i) => i % 3 === k && Number.isFinite(x));
    return own.reduce((sum, x) => sum + x, 0) / Math.max(own.length, 1);
  });
  return new Plane().setFromNormalAndCoplanarPoint(planeNormal(opened, world, rollout), new Vector3().fromArray(middle));
}

/** The nearest axis with the sign that shows x to the right, or y where x is the depth, and z upwards. */
function toAxis(v: number[]): Vector3 {
  const size = v.map(Math.abs);
  const k = size.indexOf(Math.max(...size));
  return [new Vector3(1, 0, 0), new Vector3(0, -1, 0), new Vector3(0, 0, 1)][k]!;
}
