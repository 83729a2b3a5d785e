// Builds main.js of this folder into the folder "built", as an application's bundler does: `node bundle.mjs BUNDLER MODULES`.
// three.js stays outside, because most of the time would go into it.
import { createRequire } from "node:module";

const [name, modules] = process.argv.slice(2);
const load = (program) => import(createRequire(`${modules}/`).resolve(program));
const external = [/^three/];

const BUILDERS = {
  async vite() {
    const { build } = await load("vite");
    const input = { external, input: "main.js" };
    const output = { entryFileNames: "main.js" };
    await build({ logLevel: "error", base: "./", build: { outDir: "built", rolldownOptions: { ...input, output } } });
  },
  async webpack() {
    const { default: webpack } = await load("webpack");
    const output = { path: `${process.cwd()}/built`, filename: "main.js", module: true };
    const modes = { mode: "development", devtool: false, externalsType: "module", experiments: { outputModule: true } };
    const compiler = webpack({ ...modes, entry: "./main.js", target: "web", externals: external, output });
    const run = (resolve, reject) => compiler.run((error, stats) => (error ? reject(error) : resolve(stats)));
    const stats = await new Promise(run);
    if (stats.hasErrors() || stats.hasWarnings()) throw new Error(stats.toString("errors-warnings"));
  },
  async esbuild() {
    const { build } = await load("esbuild");
    const entry = { entryPoints: ["main.js"], outdir: "built", bundle: true, format: "esm", external: ["three"] };
    const { warnings } = await build({ ...entry, logLevel: "silent" });
    if (warnings.length) throw new Error(JSON.stringify(warnings));
  },
  async rollup() {
    const { rollup } = await load("rollup");
    const { default: resolve } = await load("@rollup/plugin-node-resolve");
    const onwarn = ({ message }) => {
      throw new Error(message);
    };
    const bundle = await rollup({ input: "main.js", external, onwarn, plugins: [resolve({ browser: true })] });
    await bundle.write({ dir: "built", format: "es" });
  },
};

await BUILDERS[name]();
