// What is drawn over the film.
import { signal, type Signal } from "@preact/signals";

export interface Layer {
  key: string;
  title: string;
  does: string;
  on: Signal<boolean>;
}

const layer = (key: string, title: string, does: string, on = true): Layer => ({ key, title, does, on: signal(on) });

export const observedLayer = layer("m", "Observed", "Outlines of what was observed in the video");
export const worldLayer = layer("w", "World", "Outlines of the simulated world in the video");
export const pathLayer = layer("t", "Paths", "Paths of the simulated objects in the video");
export const nameLayer = layer("n", "Names", "Names of objects in the video");
export const LAYERS = [observedLayer, worldLayer, pathLayer, nameLayer];
