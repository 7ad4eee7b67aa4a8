// Colours of objects as lines and text: a yellow ball on white is drawn in a darker yellow.
import { token } from "./theme";

/** Least contrast of a line with what is behind it (WCAG 2.2, 1.4.11). */
const LEAST = 3;

type Rgb = [number, number, number];

/** A colour mixed with that of text until it stands out from the surface. */
export function legible(color: string): string {
  const surface = parse(token("surface"));
  const ink = parse(token("ink"));
  const own = parse(color);
  for (let share = 0; share < 1; share += 0.1) {
    const mixed = own.map((c, k) => c + share * (ink[k]! - c)) as Rgb;
    if (contrast(mixed, surface) >= LEAST) return `rgb(${mixed.map(Math.round).join(" ")})`;
  }
  return token("ink");
}

function parse(color: string): Rgb {
  if (color.startsWith("#")) return [1, 3, 5].map((k) => parseInt(color.slice(k, k + 2), 16)) as Rgb;
  return (color.match(/[\d.]+/g) ?? ["0", "0", "0"]).slice(0, 3).map(Number) as Rgb;
}

function contrast(a: Rgb, b: Rgb): number {
  const [high, low] = [luminance(a), luminance(b)].sort((p, q) => q - p) as [number, number];
  return (high + 0.05) / (low + 0.05);
}

function luminance(color: Rgb): number {
  const [r, g, b] = color.map((c) => {
    const share = c / 255;
    return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
  }) as Rgb;
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}
