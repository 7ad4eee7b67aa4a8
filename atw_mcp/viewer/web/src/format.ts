// Numbers as people read them: four significant digits, SI prefixes, times.

const PREFIXES: [number, string][] = [
  [1e9, "G"],
  [1e6, "M"],
  [1e3, "k"],
  [1, ""],
  [1e-3, "m"],
  [1e-6, "µ"],
  [1e-9, "n"],
];
const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";

/** A number with so many significant digits; powers of ten outside 0.0001 .. 1,000,000. */
export function digits(x: number | null | undefined, significant = 4): string {
  if (x === null || x === undefined || Number.isNaN(x)) return "–";
  if (!Number.isFinite(x)) return x > 0 ? "∞" : "−∞";
  if (x === 0) return "0";
  const size = Math.abs(x);
  if (size >= 1e6 || size < 1e-4) {
    const [mantissa, power] = x.toExponential(significant - 1).split("e") as [string, string];
    return sign(`${mantissa} × 10${raised(Number(power))}`);
  }
  const decimals = Math.max(0, significant - 1 - Math.floor(Math.log10(size)));
  return sign(x.toFixed(Math.min(decimals, 100)));
}

/** A unit as it is printed: m/s^2 as m/s²; nothing for 1. */
export function unitText(unit: string): string {
  if (unit === "1") return "";
  return unit.replace(/\^(-?\d+)/g, (_, power: string) => raised(Number(power)));
}

/** A number with its unit, with a prefix where that reads better: 0.00123 m as 1.230 mm. */
export function quantity(x: number | null | undefined, unit: string, significant = 4): string {
  if (x === null || x === undefined || !Number.isFinite(x)) return digits(x);
  const read = scaled(x, unit);
  return `${digits(x / read.factor, significant)} ${read.unit}`.trimEnd();
}

/** The unit in which a number of this size reads best, and how much of the unit given it is. */
export function scaled(x: number, unit: string): { factor: number; unit: string } {
  const [first = "", rest = ""] = split(unit);
  const size = Math.abs(x);
  if (size === 0 || (size >= 0.01 && size < 1e4) || !/^(m|s|N|J|W|Pa|Hz|kg|rad)$/.test(first) || /^\^/.test(rest)) {
    return { factor: 1, unit: unitText(unit) };
  }
  const grams = first === "kg";
  const [factor, prefix] = PREFIXES.find(([f]) => (grams ? size * 1000 : size) >= f * 0.9995) ?? PREFIXES.at(-1)!;
  return { factor: grams ? factor / 1000 : factor, unit: `${prefix}${grams ? "g" : first}${unitText(rest)}` };
}

/** A moment [s] to the millisecond; a half is rounded up, also where float32 holds a little less than it. */
export function moment(t: number): string {
  return `${sign((Math.round(t * 1e3 + 1e-4) / 1e3).toFixed(3))} s`;
}

/** A span of waiting [s], coarsely: 45 s, 12 min, 3 h. */
export function wait(seconds: number): string {
  if (seconds < 90) return `${Math.max(1, Math.round(seconds))} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return `${Math.round(seconds / 3600)} h`;
}

/** An object's name as words. */
export function words(name: string): string {
  return name.replaceAll("_", " ");
}

function split(unit: string): [string, string] {
  const match = /^([A-Za-z]+)(.*)$/.exec(unit);
  return match ? [match[1]!, match[2]!] : [unit, ""];
}

function sign(text: string): string {
  return text.replace("-", "−");
}

function raised(power: number): string {
  return [...String(power)].map((c) => (c === "-" ? "⁻" : SUPERSCRIPTS[Number(c)])).join("");
}
