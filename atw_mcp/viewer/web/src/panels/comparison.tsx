/** Not yet written. */
export function Comparison() {
  return <section aria-label="comparison" />;
}
