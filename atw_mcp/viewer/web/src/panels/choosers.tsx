/** Not yet written. */
export function Choosers() {
  return <section aria-label="choosers" />;
}
