// Bundle the viewer into one HTML file: node build.mjs [--out FILE].
//
// Equal sources give equal bytes. `viewer.json` beside the file states the SHA-256 of the sources and of the result, so
// that a test without Node.js sees a file that is older than its sources.
import { createHash } from "node:crypto";
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { dirname, join, relative } from "node:path";
import { fileURLToPath } from "node:url";
import { build, version as esbuild } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const at = process.argv.indexOf("--out");
const out = at > 0 ? process.argv[at + 1] : join(here, "..", "viewer.html");
const sha256 = (data) => createHash("sha256").update(data).digest("hex");

/** Digest of every file that the result depends on. */
function sources() {
  const names = ["build.mjs", "index.html", "package.json", "tsconfig.json"];
  const walk = (folder) => {
    for (const entry of readdirSync(folder, { withFileTypes: true })) {
      if (entry.isDirectory()) walk(join(folder, entry.name));
      else names.push(relative(here, join(folder, entry.name)).replaceAll("\\", "/"));
    }
  };
  walk(join(here, "src"));
  const whole = createHash("sha256");
  for (const name of names.sort()) whole.update(`${name}\n${sha256(readFileSync(join(here, name)))}\n`);
  return whole.digest("hex");
}

const result = await build({
  absWorkingDir: here,
  entryPoints: ["src/main.tsx"],
  bundle: true,
  minify: true,
  write: false,
  outdir: "out",
  format: "iife",
  target: "es2022",
  charset: "utf8",
  legalComments: "inline",
  loader: { ".css": "css" },
});
const script = result.outputFiles.find((f) => f.path.endsWith(".js")).text.replaceAll("</script", "<\\/script");
const style = result.outputFiles.find((f) => f.path.endsWith(".css"))?.text ?? "";
const hash = createHash("sha256").update(script).digest("base64");
const html = readFileSync(join(here, "index.html"), "utf8")
  .replace("{{script-hash}}", () => `sha256-${hash}`)
  .replace("{{style}}", () => style)
  .replace("{{script}}", () => script);
writeFileSync(out, html);
if (at < 0) {
  const stamp = { sources: sources(), sha256: sha256(html), bytes: Buffer.byteLength(html), esbuild };
  writeFileSync(join(here, "..", "viewer.json"), `${JSON.stringify(stamp, null, 2)}\n`);
}
console.log(`${out}: ${(Buffer.byteLength(html) / 1e3).toFixed(0)} kB`);
