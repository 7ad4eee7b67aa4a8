/** Not yet written. */
export function Transport() {
  return <section aria-label="transport" />;
}
