// The page as its host wants it: light or dark, in the conversation or full screen, away from a phone's edges.
import type { Host } from "./host";
import type { HostContext } from "./host_types";
import { effect } from "@preact/signals";
import { unfolded } from "./hosted";
import { preference } from "./theme";

/** Follow the host's theme, fonts, display mode and safe area. */
export function appearance(context: HostContext): void {
  const root = document.documentElement;
  if (context.theme) preference.value = context.theme;
  for (const [name, value] of Object.entries(context.styles?.variables ?? {})) {
    if (name.startsWith("--") && value !== undefined) root.style.setProperty(name, value);
  }
  root.dataset.host = context.displayMode ?? "inline";
  const { top = 0, right = 0, bottom = 0, left = 0 } = context.safeAreaInsets ?? {};
  document.body.style.padding = `${top}px ${right}px ${bottom}px ${left}px`;
}

effect(() => {
  document.documentElement.toggleAttribute("data-unfolded", unfolded.value);
});

/** Report the height of the content to the host whenever it changes, as long as the height is the page's to choose. */
export function reportSize(host: Host): void {
  let last = 0;
  const report = () => {
    const fixed = host.context.displayMode === "fullscreen" || host.context.containerDimensions?.height !== undefined;
    const height = fixed ? 0 : Math.ceil(document.body.getBoundingClientRect().height);
    if (height !== last && !fixed) {
      host.notify("ui/notifications/size-changed", { width: Math.ceil(innerWidth), height });
    }
    last = height;
    requestAnimationFrame(report); // not a ResizeObserver of the body: panels resize in observers of their own
  };
  report();
}
