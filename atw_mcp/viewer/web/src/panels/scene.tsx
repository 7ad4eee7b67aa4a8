/** Not yet written. */
export function Scene() {
  return <section aria-label="scene" />;
}
