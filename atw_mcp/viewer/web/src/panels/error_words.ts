// What errors of a fit are measured in, in words.
const ERRORS: Record<string, string> = {
  m: ", as a root mean square distance",
  sigma: ", in standard deviations of the measurement",
  "σ²": ", as a mean square in variances of the measurement",
};

/** The end of a sentence about an error: how it was averaged and in which unit; "" for others. */
export function errorWords(unit: string): string {
  return ERRORS[unit] ?? "";
}
