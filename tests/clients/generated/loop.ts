// The loop through the types of openapi-typescript and openapi-fetch: from photographs to a mission.

import { createHash } from "node:crypto";
import { readFile, readdir, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { setTimeout } from "node:timers/promises";
import createClient from "openapi-fetch";
import type { components, paths } from "./fvs-rest.js";

type Problem = components["schemas"]["Problem"];

/** What was asked for; else there is a problem, with a hint. */
function a<T>({ data, error }: { data?: T; error?: Problem }): T {
  if (error !== undefined || data === undefined) {
    throw new Error(`${error?.detail} ${error?.hint}`);
  }
  return data;
}

/** Bytes as a body: openapi-typescript has strings for them. */
const bytes = (content: Uint8Array) => ({
  body: content as unknown as string,
  bodySerializer: (body?: string) => body as BodyInit,
});

const digest = (content: Uint8Array) => createHash("sha256").update(content).digest("hex");
const base64 = (text: string) => Buffer.from(text).toString("base64");

const [url, key, folder, out] = process.argv.slice(2) as [string, string, string, string];
const client = createClient<paths>({ baseUrl: url, headers: { Authorization: `Bearer ${key}` } });

const scene = a(await client.POST("/v1/scenes", { body: { name: "typescript" } }));
const path = { scene_id: scene.id };

const [form, parts, ...others] = (await readdir(folder)).sort() as [string, string, ...string[]];
const file = new Blob([new Uint8Array(await readFile(join(folder, form)))]);
a(
  await client.POST("/v1/scenes/{scene_id}/images", {
    params: { path },
    body: { file: [form] },
    bodySerializer: () => {
      const data = new FormData();
      data.append("file", file, form);
      return data;
    },
  }),
);

const whole = await readFile(join(folder, parts));
const metadata = { scene: scene.id, sha256: digest(whole), filename: parts };
const created = await client.POST("/v1/uploads", {
  params: {
    header: {
      "Tus-Resumable": "1.0.0",
      "Upload-Length": String(whole.length),
      "Upload-Metadata": Object.entries(metadata)
        .map(([name, value]) => `${name} ${base64(value)}`)
        .join(","),
    },
  },
});
const upload_id = created.response.headers.get("Location")!.split("/").at(-1)!;
const half = whole.length >> 1;
for (const [offset, part] of [[0, whole.subarray(0, half)], [half, whole.subarray(half)]] as const) {
  const sent = await client.PATCH("/v1/uploads/{upload_id}", {
    params: { path: { upload_id }, header: { "Tus-Resumable": "1.0.0", "Upload-Offset": String(offset) } },
    headers: { "Content-Type": "application/offset+octet-stream" },
    ...bytes(part),
  });
  if (sent.error) throw new Error(sent.error.detail);
}

for (const name of others) {
  const content = await readFile(join(folder, name));
  a(
    await client.PUT("/v1/scenes/{scene_id}/images/sha256:{hexadecimal}", {
      params: { path: { ...path, hexadecimal: digest(content) }, query: { name } },
      headers: { "Content-Type": "application/octet-stream" },
      ...bytes(content),
    }),
  );
}

let job = a(await client.POST("/v1/scenes/{scene_id}/jobs", { params: { path }, body: { kind: "update" } }));
while (job.state === "queued" || job.state === "running") {
  await setTimeout(500);
  job = a(await client.GET("/v1/jobs/{job_id}", { params: { path: { job_id: job.id } } }));
}
if (job.state !== "succeeded") throw new Error(job.error?.message);

const generator = { kind: "orbit", count: 4 } as const;
const ranking = a(
  await client.POST("/v1/scenes/{scene_id}/rankings", {
    params: { path },
    body: { generator, top_k: 2, rank_all: true },
  }),
);
if (typeof ranking === "string") throw new Error("a stream, which was not asked for");
const best = ranking.candidates[0]!;
const png = await client.GET("/v1/rankings/{ranking_id}/candidates/{candidate_id}/{image}.png", {
  params: { path: { ranking_id: ranking.id, candidate_id: best.id, image: "render" } },
  parseAs: "arrayBuffer",
});
await writeFile(join(out, "best.png"), Buffer.from(a(png)));

const plan = a(
  await client.POST("/v1/scenes/{scene_id}/plans", { params: { path }, body: { generator, views: 2 } }),
);
const views = plan.tours.flatMap((tour) => tour.stops).map(({ id, pose }) => ({ id, pose }));
const mission = await client.POST("/v1/scenes/{scene_id}/missions", {
  params: { path, query: { format: "nerfstudio" } },
  body: { views },
  parseAs: "text",
});
await writeFile(join(out, "mission.json"), a(mission));
