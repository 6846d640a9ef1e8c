import { afterEach, expect, it, vi } from "vitest";
import { rankingParts } from "./rankings";

afterEach(() => vi.unstubAllGlobals());

async function partsOf(body: string): Promise<unknown[]> {
  vi.stubGlobal("fetch", async () => new Response(body));
  const parts: unknown[] = [];
  for await (const part of rankingParts("scn_1", {}, new AbortController().signal)) parts.push(part);
  return parts;
}

const scored = 'data: {"candidates":[{"id":"a"}],"ranking":null}\n\n';

it("Parts arrive, and the last has the ranking", async () => {
  const parts = await partsOf(`${scored}data: {"candidates":[],"ranking":{"id":"rnk_1"}}\n\n`);
  expect(parts).toHaveLength(2);
  expect(parts[1]).toEqual({ candidates: [], ranking: { id: "rnk_1" } });
});

it("A problem in the stream is an error with its hint", async () => {
  const problem = { detail: "Too slow.", hint: "Rank fewer.", code: "deadline", status: 503, errors: [] };
  await expect(
    partsOf(`${scored}event: problem\ndata: ${JSON.stringify(problem)}\n\n`),
  ).rejects.toMatchObject({ message: "Too slow.", hint: "Rank fewer.", status: 503 });
});

it("A stream that ends before the ranking is an error", async () => {
  await expect(partsOf(scored)).rejects.toThrow("before it was complete");
});
