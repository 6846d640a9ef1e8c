import type { Plugin } from "vite";

const CONTENT = /const jsContent = ('(?:[^'\\]|\\.)*');\n/;
const BLOB = /const blob = typeof self [^\n]*\n/;
const WRAPPER = /function WorkerWrapper\(options\) \{\n[\s\S]*?\n\}\n/;

/**
 * Make the worker of Spark a file of its own.
 *
 * Spark's module has the worker's source in a string and starts it from a `blob:` URL, which the page's Content
 * Security Policy forbids.
 */
export function sparkWorker(): Plugin {
  return {
    name: "spark-worker",
    apply: "build",
    transform(code, id) {
      if (!id.includes("@sparkjsdev/spark/dist/spark.module.js")) return undefined;
      const content = CONTENT.exec(code)?.[1];
      if (!content || !BLOB.test(code) || !WRAPPER.test(code)) {
        throw new Error("Spark's module does not start its worker as it did: adapt plugins/spark-worker.ts.");
      }
      const source = new Function(`return ${content};`)() as string;
      const file = this.emitFile({ type: "asset", name: "spark-worker.js", source });
      const wrapper = `function WorkerWrapper(options) {
  return new Worker(import.meta.ROLLUP_FILE_URL_${file}, { name: options?.name });
}
`;
      return {
        code: code
          .replace(CONTENT, "")
          .replace(BLOB, "")
          .replace(WRAPPER, () => wrapper),
        map: null,
      };
    },
  };
}
