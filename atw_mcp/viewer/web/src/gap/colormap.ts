// A sequential map of colours that colour-blind people can read: cividis (Nuñez, Anderton & Renslow 2018).
const STOPS: [number, number, number][] = [
  [0, 34, 78],
  [18, 53, 112],
  [59, 73, 108],
  [87, 93, 109],
  [112, 113, 115],
  [138, 134, 120],
  [165, 156, 116],
  [195, 179, 105],
  [225, 204, 85],
  [254, 232, 56],
];

/** Part of the map at its small end that is left out: next to the page's own colour dots would not be seen. */
const UNSEEN = 0.2;

/** Colour of a share 0 .. 1; large is what stands out: bright on dark, dark on light. */
export function cividis(share: number, onDark: boolean): string {
  const part = UNSEEN + (1 - UNSEEN) * Math.min(Math.max(share, 0), 1);
  const x = (onDark ? part : 1 - part) * (STOPS.length - 1);
  const k = Math.min(Math.floor(x), STOPS.length - 2);
  const mixed = STOPS[k]!.map((v, i) => Math.round(v + (x - k) * (STOPS[k + 1]![i]! - v)));
  return `rgb(${mixed.join(" ")})`;
}
