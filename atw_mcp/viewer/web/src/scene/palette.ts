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
    background: new Color(night ? "#12161b" : "#eef1f4"),
    floor: new Color(night ? "#20262d" : "#fbfcfd"),
    grid: new Color(night ? "#46505b" : "#b9c2cc"),
    joint: new Color(token("ink")),
    region: new Color(token("ink-soft")),
    rim: new Color(token("surface")),
    chosen: new Color(token("cursor")),
    branch: new Color(token("branch")),
    bounce: new Color(night ? "#4d5763" : "#c9d0d8"),
    ambient: night ? 1.5 : 1.9,
    lamp: night ? 1.9 : 1.7,
    shadow: night ? 0.75 : 0.42,
  };
}
