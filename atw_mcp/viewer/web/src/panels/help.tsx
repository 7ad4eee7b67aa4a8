// A dialog that lists the keys.
import { useRef } from "preact/hooks";
import { useSignalEffect } from "@preact/signals";
import { BINDINGS, helpOpen } from "../keys";
import "./help.css";

export function Help() {
  const dialog = useRef<HTMLDialogElement>(null);
  useSignalEffect(() => {
    if (helpOpen.value) dialog.current?.showModal();
    else dialog.current?.close();
  });
  return (
    <dialog ref={dialog} class="help" aria-labelledby="help-title" onClose={() => (helpOpen.value = false)}>
      <h2 id="help-title">Keys</h2>
      <dl>
        {BINDINGS.flatMap(({ key, shown, does }) => [
          <dt key={key}>
            <kbd>{shown}</kbd>
          </dt>,
          <dd key={`${key} does`}>{does}</dd>,
        ])}
      </dl>
      <p class="soft small">
        On the timeline: drag along the axis to enlarge an interval, turn the wheel over the axis (elsewhere with Ctrl) to
        zoom, double-click to see all.
      </p>
      <p>
        <button class="primary" onClick={() => (helpOpen.value = false)}>
          Close
        </button>
      </p>
    </dialog>
  );
}
