/** Not yet written. */
export function Provenance() {
  return <section aria-label="provenance" />;
}
