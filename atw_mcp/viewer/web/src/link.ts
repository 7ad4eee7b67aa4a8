// The address of what is shown: tab, time, rollouts and object behind the #, so that a link leads back to it.
import { batch, effect } from "@preact/signals";
import { chosen, compared, layout, object, opened, playing, rolloutOf, seek, tab, time, type Tab } from "./state";

/** How long nothing changes before the address does [ms]: browsers limit how often it may, and are slow about it. */
const AT_REST = 300;
let waiting = 0;

/** Show what the address says, now and when it changes, and keep it at what is shown. */
export function linked(): void {
  if (!opened.value || !/^(https?|file):$/.test(location.protocol)) return; // a host's frame has no address of its own
  follow();
  window.addEventListener("hashchange", follow);
  effect(() => {
    const said = new URLSearchParams({ tab: tab.value });
    if (chosen.value) said.set("rollout", chosen.value);
    if (layout.value !== "one" && compared.value) {
      said.set("with", compared.value);
      said.set("layout", layout.value);
    }
    if (object.value) said.set("object", object.value);
    if (playing.value) return;
    said.set("t", String(Number(time.value.toFixed(4))));
    clearTimeout(waiting);
    waiting = setTimeout(() => history.replaceState(null, "", `#${said}`), AT_REST);
  });
}

function follow(): void {
  const said = new URLSearchParams(location.hash.slice(1));
  const [first, second] = [said.get("rollout"), said.get("with")];
  batch(() => {
    if (said.has("tab")) tab.value = said.get("tab") as Tab; // one that is not there is the first
    if (rolloutOf(first)) chosen.value = first;
    if (rolloutOf(second) && second !== chosen.value) {
      compared.value = second;
      layout.value = said.get("layout") === "side" ? "side" : "ghost";
    }
    if (said.has("object")) object.value = said.get("object");
  });
  if (said.has("t")) seek(Number(said.get("t")) || 0);
}
