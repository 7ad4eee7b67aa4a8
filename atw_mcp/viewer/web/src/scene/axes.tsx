// The directions of x, y, z and of gravity as the eye sees them, in a corner of the scene.
import { type Camera, Vector3 } from "three";
import { quantity } from "../format";

interface Arm {
  name: string;
  /** Along the screen to the right and down, and towards the eye: -1..1. */
  x: number;
  y: number;
  depth: number;
}

export interface AxesOf {
  arms: Arm[];
  gravity: Arm | null;
  /** [m/s^2]; null: not known. */
  strength: number | null;
}

/** gravity [m/s^2]; null: not known, there is no world. */
export function axesOf(camera: Camera, gravity: readonly number[] | null): AxesOf {
  const seen = (v: Vector3, name: string): Arm => {
    v.transformDirection(camera.matrixWorldInverse);
    const round = (a: number) => Math.round(200 * a) / 200;
    return { name, x: round(v.x), y: round(-v.y), depth: round(v.z) };
  };
  const strength = gravity && Math.hypot(...gravity);
  return {
    arms: [seen(new Vector3(1, 0, 0), "x"), seen(new Vector3(0, 1, 0), "y"), seen(new Vector3(0, 0, 1), "z")],
    gravity: strength ? seen(new Vector3().fromArray(gravity as number[]), "g") : null,
    strength,
  };
}

const ARM = 26;
const SIDE = 84;

export function Axes({ arms, gravity, strength }: AxesOf) {
  const order = [...arms].sort((a, b) => a.depth - b.depth);
  return (
    <figure class="axes" aria-label={strength === null ? "axes" : `axes; gravity ${quantity(strength, "m/s^2")}`}>
      <svg viewBox={`${-SIDE / 2} ${-SIDE / 2} ${SIDE} ${SIDE}`} width={SIDE} height={SIDE} aria-hidden="true">
        {gravity && (
          <g class="g">
            <line x2={0.75 * ARM * gravity.x} y2={0.75 * ARM * gravity.y} />
            <Head arm={gravity} length={0.75 * ARM} />
          </g>
        )}
        {order.map((a) => (
          <g key={a.name} class={a.name} opacity={a.depth < -0.2 ? 0.6 : 1}>
            <line x2={ARM * a.x} y2={ARM * a.y} />
            <text x={(ARM + 8) * a.x} y={(ARM + 8) * a.y}>
              {a.name}
            </text>
          </g>
        ))}
      </svg>
      <figcaption>{strength === null ? "" : strength > 0 ? `g ${quantity(strength, "m/s^2", 3)}` : "no gravity"}</figcaption>
    </figure>
  );
}

function Head({ arm, length }: { arm: Arm; length: number }) {
  const size = Math.hypot(arm.x, arm.y);
  if (size < 0.15) return <circle r={3} />; // straight towards the eye or away from it
  const [dx, dy] = [arm.x / size, arm.y / size];
  const [tx, ty] = [length * arm.x + 4 * dx, length * arm.y + 4 * dy];
  const back = (side: number) => `${tx - 8 * dx - 4 * side * dy},${ty - 8 * dy + 4 * side * dx}`;
  return <polygon points={`${tx},${ty} ${back(1)} ${back(-1)}`} />;
}
