import { readFileSync } from "node:fs";
import { defineConfig } from "vitest/config";
import { sparkFiles } from "./plugins/spark-files.ts";

const VERSION = /^version = "(.*)"$/m.exec(readFileSync("../../pyproject.toml", "utf8"))?.[1];
const SERVICE = process.env.FVS_URL ?? "http://127.0.0.1:8000";

export default defineConfig({
  base: "/console/",
  plugins: [sparkFiles()],
  define: { __FVS_VERSION__: JSON.stringify(VERSION) },
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
  build: {
    outDir: "../../services/fvs_service/console/built",
    emptyOutDir: true,
    target: "es2022",
    assetsInlineLimit: 0, // no data: URLs, which the page's Content Security Policy forbids
    chunkSizeWarningLimit: 3000,
    modulePreload: { polyfill: false },
    rolldownOptions: {
      output: {
        codeSplitting: {
          includeDependenciesRecursively: false,
          groups: [
            { name: "spark", test: /node_modules\/(@sparkjsdev|fflate)/ },
            { name: "three", test: /node_modules\/three/ },
            { name: "maplibre", test: /node_modules\/(maplibre-gl|pmtiles|@mapbox|@maplibre)/ },
            { name: "preact", test: /node_modules\/(preact|@preact)/ },
          ],
        },
      },
    },
  },
  server: {
    proxy: Object.fromEntries(
      ["/v1", "/openapi.json", "/console/basemap.pmtiles"].map((path) => [
        path,
        { target: SERVICE, changeOrigin: true, headers: { Origin: SERVICE } }, // it refuses other origins
      ]),
    ),
  },
  test: { environment: "happy-dom", isolate: false, include: ["src/**/*.test.ts", "src/**/*.test.tsx"] },
});
