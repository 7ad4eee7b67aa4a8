// Marks of events: a shape for each kind, so that colour is never the only difference.
import type { Kind } from "../events";

/** A mark about the origin, `size` times 5 px in radius; coloured by `color` of the element around it. */
export function Shape({ kind, size = 1 }: { kind: Kind; size?: number }) {
  const r = 5 * size;
  switch (kind) {
    case "contact_begin":
      return <circle r={r} fill="currentColor" />;
    case "contact_end":
      return <circle r={4} fill="var(--surface)" stroke="currentColor" stroke-width="2" />;
    case "entry":
      return <path d="M-5-6L6 0L-5 6z" fill="currentColor" />;
    case "exit":
      return <path d="M5-6L-6 0L5 6z" fill="var(--surface)" stroke="currentColor" stroke-width="2" />;
    case "rest":
      return <path d="M-5-5h10v10h-10z" fill="currentColor" />;
    case "release":
      return <path d="M0-6L6 0L0 6L-6 0z" fill="var(--surface)" stroke="currentColor" stroke-width="2" />;
  }
}
