/** Not yet written. */
export function Timeline() {
  return <section aria-label="timeline" />;
}
