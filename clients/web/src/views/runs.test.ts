import { signal } from "@preact/signals";
import { afterEach, expect, it, vi } from "vitest";
import type { SceneStore } from "../store/scene";
import { ForecastRun } from "./forecast-run";
import { RankingRun } from "./ranking-run";

afterEach(() => vi.unstubAllGlobals());

const frames = {
  georeferenced: false,
  alignment: { rotation_wxyz: [1, 0, 0, 0] },
  worldFromModel: (x: unknown) => x,
};
const cameras = () => ({
  centre: [0, 0, 0],
  views: [{ image: "a", position: [1, 0, 0], orientation_wxyz: [1, 0, 0, 0] }],
});

function storeOf(): SceneStore {
  return {
    id: "scn_1",
    scene: signal({}),
    frames: signal(frames),
    cameras: signal(cameras()),
    imageByDigest: signal(new Map()),
    drawings: signal([]),
    chosenDrawing: signal(null),
    selection: signal(null),
    chosenSnapshot: signal(null),
    snapshots: signal([{ id: "snp_1" }]),
    snapshot: signal({ id: "snp_1" }),
    ranking: signal(null),
    forecast: signal(null),
  } as unknown as SceneStore;
}

function answering(body: string): string[] {
  const asked: string[] = [];
  vi.stubGlobal("fetch", async (request: Request) => {
    asked.push(new URL(request.url).pathname);
    return new Response(body, { headers: { "Content-Type": "application/json" } });
  });
  return asked;
}

it("A forecast is asked for when it is shown, and for each new model, but not when something is selected", async () => {
  const asked = answering('{"samples": []}');
  const store = storeOf();
  const run = new ForecastRun(store);
  expect(asked).toHaveLength(0);
  run.place.value = "surface";
  await vi.waitFor(() => expect(store.forecast.value).not.toBeNull());
  store.selection.value = { kind: "image", digest: "a" };
  store.scene.value = { ...store.scene.value } as never;
  expect(asked).toEqual(["/v1/scenes/scn_1/forecasts"]);
  store.cameras.value = cameras() as never;
  await vi.waitFor(() => expect(asked).toHaveLength(2));
  run.place.value = null;
  expect(store.forecast.value).toBeNull();
});

it("A new model is ranked once its cameras are there, if that is wanted", async () => {
  const asked = answering('data: {"candidates": [], "ranking": {"id": "rnk_1"}}\n\n');
  const store = storeOf();
  const run = new RankingRun(store);
  const next = (id: string) => {
    store.snapshots.value = [{ id }] as never;
    expect(run.progress.value).toBeNull();
    store.cameras.value = cameras() as never;
  };
  next("snp_2");
  expect(asked).toHaveLength(0);
  run.keepUpToDate.value = true;
  next("snp_3");
  await vi.waitFor(() => expect(store.ranking.value).toEqual({ id: "rnk_1" }));
  expect(asked).toEqual(["/v1/scenes/scn_1/rankings"]);
});
