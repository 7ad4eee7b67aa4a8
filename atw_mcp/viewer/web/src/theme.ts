// Light or dark: the system's preference unless the toggle says otherwise; and the tokens of style.css for canvases.
import { computed, effect, signal } from "@preact/signals";

export type Preference = "system" | "light" | "dark";

export const preference = signal<Preference>("system");
const query = matchMedia("(prefers-color-scheme: dark)");
const system = signal(query.matches);
query.addEventListener("change", () => (system.value = query.matches));

export const dark = computed(() => (preference.value === "system" ? system.value : preference.value === "dark"));

/** True where the system asks for little motion. */
export const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

effect(() => {
  const root = document.documentElement;
  if (preference.value === "system") delete root.dataset.theme;
  else root.dataset.theme = preference.value;
});

const probe = document.createElement("span");
/** Value of a colour token, such as "base" for --base, as rgb(...); read inside an effect it follows the theme. */
export function token(name: string): string {
  void dark.value;
  if (!probe.isConnected) {
    probe.hidden = true;
    document.body.append(probe);
  }
  probe.style.color = `var(--${name})`;
  return getComputedStyle(probe).color;
}
