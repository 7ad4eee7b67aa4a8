/** Not yet written. */
export function Objects() {
  return <section aria-label="objects" />;
}
