// Colours of the scene: the page's tokens, and how bright its lamps are.
import { Color } from "three";
import { dark, token } from "../theme";

export interface Palette {
  background: Color;
  floor: Color;
  grid: Color;
  joint: Color;
  region: Color;
  rim: Color;
  chosen: Color;
  branch: Color;
  /** Light that comes back from below. */
  bounce: Color;
  ambient: number;
  lamp: number;
  /** How dark a shadow is, 0..1. */
  shadow: number;
}

export function palette(): Palette {
  const night = dark.value;
  return {
    background: new Color(night ? "#12161b" : "#e3e8ed"),
    floor: new Color(night ? "#20262d" : "#f2f4f6"),
    grid: new Color(night ? "#46505b" : "#aeb8c3"),
    joint: new Color(token("ink")),
    region: new Color(token("ink-soft")),
    rim: new Color(token("surface")),
    chosen: new Color(token("cursor")),
    branch: new Color(token("branch")),
    bounce: new Color(night ? "#4d5763" : "#c9d0d8"),
    ambient: night ? 1.25 : 1.3,
    lamp: night ? 2.2 : 1.9,
    shadow: night ? 0.85 : 0.6,
  };
}

/** A colour as it is, or darker by day and lighter by night where a thin line of it would not stand out. */
export function distinct(color: string, on: Color): Color {
  const made = new Color(color);
  const light = (c: Color) => 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b;
  const back = light(on);
  const target = new Color(back > 0.4 ? 0x000000 : 0xffffff);
  // the ratio of luminances of the accessibility guidelines; theirs for graphics is 3, lines here have their objects too
  for (let i = 0; i < 12; i++) {
    const [low, high] = [light(made), back].sort((a, b) => a - b) as [number, number];
    if ((high + 0.05) / (low + 0.05) >= 2) break;
    made.lerp(target, 0.12);
  }
  return made;
}
