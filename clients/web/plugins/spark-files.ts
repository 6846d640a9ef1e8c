import type { Plugin } from "vite";

const CONTENT = /const jsContent = ('(?:[^'\\]|\\.)*');\n/;
const BLOB = /const blob = typeof self [^\n]*\n/;
const WRAPPER = /function WorkerWrapper\(options\) \{\n[\s\S]*?\n\}\n/;

const WASM =
  /const WASM = decode64\("([^"]*)"\)\.buffer;\nconst WASM_MODULE = WebAssembly\.compile\(WASM\);\n/;

/**
 * Make the worker and the WebAssembly of Spark files of their own.
 *
 * Spark's module has the worker's source in a string and starts it from a `blob:` URL, which the page's Content
 * Security Policy forbids; its WebAssembly is in base 64, which cannot be compiled while it arrives.
 */
export function sparkFiles(): Plugin {
  return {
    name: "spark-files",
    apply: "build",
    transform(code, id) {
      if (!id.includes("@sparkjsdev/spark/dist/spark.module.js")) return undefined;
      const content = CONTENT.exec(code)?.[1];
      const wasm = WASM.exec(code)?.[1];
      if (!content || !wasm || !BLOB.test(code) || !WRAPPER.test(code)) {
        throw new Error("Spark's module is not written as it was: adapt plugins/spark-files.ts.");
      }
      const source = new Function(`return ${content};`)() as string;
      const file = this.emitFile({ type: "asset", name: "spark-worker.js", source });
      const module = this.emitFile({
        type: "asset",
        name: "spark.wasm",
        source: Buffer.from(wasm, "base64"),
      });
      const compiled = `const WASM_MODULE = WebAssembly.compileStreaming(fetch(import.meta.ROLLUP_FILE_URL_${module}));\n`;
      const wrapper = `function WorkerWrapper(options) {
  return new Worker(import.meta.ROLLUP_FILE_URL_${file}, { name: options?.name });
}
`;
      return {
        code: code
          .replace(CONTENT, "")
          .replace(BLOB, "")
          .replace(WASM, () => compiled)
          .replace(WRAPPER, () => wrapper),
        map: null,
      };
    },
  };
}
