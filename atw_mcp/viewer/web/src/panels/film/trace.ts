// Outlines of labelled regions of a picture.

/** Points x, y, x, y, ... of closed curves, in pixels with the centre of the first pixel at 0, 0. */
export type Loop = Float32Array;

/**
 * Follow the border of every region of equal label other than 0 between its pixels; returns the curves of each label,
 * inner ones too. Pixels touch along edges.
 *
 * labels (height, width), rows from the top.
 */
export function trace(labels: Uint8Array, width: number, height: number): Map<number, Loop[]> {
  const found = new Map<number, Loop[]>();
  // a border is followed with its region to the right, so that it goes up the left edge of some pixel: once for each
  const followed = new Uint8Array(labels.length);
  const label = (x: number, y: number) => (x < 0 || y < 0 || x >= width || y >= height ? 0 : labels[y * width + x]!);
  for (let y = 0; y < height; y++) {
    let left = 0;
    for (let x = 0; x < width; x++) {
      const here = labels[y * width + x]!;
      if (here !== 0 && here !== left && followed[y * width + x] === 0) {
        const loops = found.get(here) ?? [];
        found.set(here, loops);
        loops.push(smooth(follow(here, x, y)));
      }
      left = here;
    }
  }
  return found;

  function follow(inside: number, startX: number, startY: number): number[] {
    let x = startX;
    let y = startY + 1; // a corner of pixels: the lower left one of the pixel
    let dx = 0;
    let dy = -1;
    const corners: number[] = [];
    do {
      if (dy === -1) followed[(y - 1) * width + x] = 1;
      x += dx;
      y += dy;
      corners.push(x, y);
      // the pixels ahead of the corner, to the left and to the right
      const leftIn = label(x + (dx + dy - 1) / 2, y + (dy - dx - 1) / 2) === inside;
      const rightIn = label(x + (dx - dy - 1) / 2, y + (dy + dx - 1) / 2) === inside;
      if (!rightIn) [dx, dy] = [-dy, dx];
      else if (leftIn) [dx, dy] = [dy, -dx];
    } while (x !== startX || y !== startY + 1 || dx !== 0 || dy !== -1);
    return corners;
  }
}

/** Middles of the edges of pixels, each moved towards its neighbours: without the stairs of the pixels. */
function smooth(corners: number[]): Loop {
  const count = corners.length / 2;
  const middles = new Float32Array(2 * count);
  for (let i = 0; i < count; i++) {
    const next = (i + 1) % count;
    middles[2 * i] = (corners[2 * i]! + corners[2 * next]!) / 2 - 0.5;
    middles[2 * i + 1] = (corners[2 * i + 1]! + corners[2 * next + 1]!) / 2 - 0.5;
  }
  const out = new Float32Array(2 * count);
  for (let i = 0; i < count; i++) {
    const before = (i + count - 1) % count;
    const next = (i + 1) % count;
    for (let k = 0; k < 2; k++) {
      out[2 * i + k] = (middles[2 * before + k]! + 2 * middles[2 * i + k]! + middles[2 * next + k]!) / 4;
    }
  }
  return out;
}
