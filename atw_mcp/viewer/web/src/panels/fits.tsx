/** Not yet written. */
export function Fits() {
  return <section aria-label="fits" />;
}
