/** Not yet written. */
export function Evidence() {
  return <section aria-label="evidence" />;
}
