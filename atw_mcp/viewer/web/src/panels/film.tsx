/** Not yet written. */
export function Film() {
  return <section aria-label="film" />;
}
