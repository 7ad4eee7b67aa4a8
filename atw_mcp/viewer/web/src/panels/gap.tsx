/** Not yet written. */
export function Gap() {
  return <section aria-label="gap" />;
}
