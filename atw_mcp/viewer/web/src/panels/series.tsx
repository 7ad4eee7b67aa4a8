/** Not yet written. */
export function Series() {
  return <section aria-label="series" />;
}
