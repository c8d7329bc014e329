// Builds the page into the sources of dermis-live: index.html, viewer.js, viewer.css. The same sources and lock file give the same bytes.
import { build } from "esbuild";
import { copyFile, mkdir, readFile } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import path from "node:path";

const here = path.dirname(fileURLToPath(import.meta.url));

/** Where dermis-live takes the page from. */
export const PAGE = path.join(here, "../dermis-live/src/sinks/viewer/page");

/** The licences of some packages, whole, as they ask to be passed on. */
async function notices(...packages) {
  const texts = await Promise.all(
    packages.map(async (name) => {
      const text = await readFile(path.join(here, "node_modules", name, "LICENSE"), "utf8");
      return `Contains ${name}.\n${text.trim()}`;
    }),
  );
  return `/*!\n${texts.join("\n\n")}\n*/`;
}

export async function buildInto(folder) {
  await mkdir(folder, { recursive: true });
  // three has no style sheet.
  const banner = { js: await notices("three", "uplot"), css: await notices("uplot") };
  const options = {
    absWorkingDir: here,
    outdir: folder,
    bundle: true,
    minify: true,
    format: "iife",
    target: ["es2022"],
    legalComments: "inline",
    define: { "process.env.NODE_ENV": '"production"' },
    logLevel: "warning",
  };
  const result = await build({ ...options, entryPoints: { viewer: "src/main.ts" }, banner, metafile: true });
  // The page of a robot holds no code of other packages, and adds to the style sheet of the other one.
  await build({ ...options, entryPoints: { robot: "src/robot/main.ts" } });
  await copyFile(path.join(here, "src/index.html"), path.join(folder, "index.html"));
  await copyFile(path.join(here, "src/robot/robot.html"), path.join(folder, "robot.html"));
  return result.metafile;
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  const { outputs } = await buildInto(PAGE);
  for (const [name, { bytes }] of Object.entries(outputs)) console.log(`${name}: ${(bytes / 1000).toFixed(1)} kB`);
}
