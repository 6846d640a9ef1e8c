import { afterEach, expect, it, vi } from "vitest";
import { named, SceneList } from "./scene-list";

afterEach(() => vi.unstubAllGlobals());

/** A service with scenes of these names, a page of two at a time. */
function serve(names: string[]) {
  vi.stubGlobal("fetch", async (request: Request) => {
    const start = Number(new URL(request.url).searchParams.get("after") ?? 0);
    const items = names.slice(start, start + 2).map((name) => ({ id: name, name }));
    return Response.json({ items, next: start + 2 < names.length ? String(start + 2) : null });
  });
}

it("loads pages on request, and those again", async () => {
  serve(["e", "d", "c", "b", "a"]);
  const list = new SceneList();
  await list.reload();
  expect(list.scenes.value?.length).toBe(2);
  await list.loadMore();
  expect(list.hasMore.value).toBe(true);
  await list.reload();
  expect(list.scenes.value?.map((scene) => scene.name)).toEqual(["e", "d", "c", "b"]);
  await list.loadAll();
  expect(list.scenes.value?.length).toBe(5);
  expect(list.hasMore.value).toBe(false);
});

it("finds names in any case", async () => {
  serve(["North quarry", "Castle"]);
  const list = new SceneList();
  await list.reload();
  expect(named(list.scenes.value ?? [], " QUARRY ").map((scene) => scene.name)).toEqual(["North quarry"]);
  expect(named(list.scenes.value ?? [], "  ").length).toBe(2);
});
