import { afterEach, expect, it, vi } from "vitest";
import { SceneList } from "./scene-list";

afterEach(() => vi.unstubAllGlobals());

/** A service with scenes of these names, a page of two at a time. */
function serve(names: string[]) {
  vi.stubGlobal("fetch", async (request: Request) => {
    const query = new URL(request.url).searchParams;
    const start = Number(query.get("after") ?? 0);
    const found = names.filter((name) => name.includes(query.get("search") ?? ""));
    const items = found.slice(start, start + 2).map((name) => ({ id: name, name }));
    return Response.json({ items, next: start + 2 < found.length ? String(start + 2) : null });
  });
}

function namesOf(list: SceneList) {
  return list.scenes.value?.map((scene) => scene.name);
}

it("loads pages on request, and those again", async () => {
  serve(["e", "d", "c", "b", "a"]);
  const list = new SceneList();
  await list.search("");
  await list.loadMore();
  await list.reload();
  expect(namesOf(list)).toEqual(["e", "d", "c", "b"]);
  expect(list.hasMore.value).toBe(true);
  await list.loadMore();
  expect(list.scenes.value?.length).toBe(5);
  expect(list.hasMore.value).toBe(false);
});

it("shows what was searched for last", async () => {
  serve(["quarry 2", "castle", "quarry 1"]);
  const list = new SceneList();
  const first = list.search("c");
  await list.search(" quarry ");
  await first;
  expect(namesOf(list)).toEqual(["quarry 2", "quarry 1"]);
  expect(list.searched.value).toBe("quarry");
});
