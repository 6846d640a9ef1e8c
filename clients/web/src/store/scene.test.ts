import { afterEach, expect, it, vi } from "vitest";
import { SceneStore } from "./scene";

afterEach(() => {
  vi.unstubAllGlobals();
  vi.useRealTimers();
});

/** A service with one scene, whose stream of events stays open; `answer` may answer first. */
function serve(answer: (path: string) => Promise<Response> | Response | null) {
  vi.stubGlobal("fetch", async (request: Request) => {
    const path = new URL(request.url).pathname.replace("/v1/scenes/scn_1", "");
    const given = await answer(path);
    if (given) return given;
    if (path !== "/events") return Response.json({ items: [], next: null, visits: [], origin: null });
    const start = (stream: ReadableStreamDefaultController) =>
      stream.enqueue(new TextEncoder().encode("id: 1\n\n"));
    return new Response(new ReadableStream({ start }));
  });
}

it("A scene of which a list could not be loaded is not live until it is", async () => {
  vi.useFakeTimers({ toFake: ["setTimeout"] });
  let failures = 1;
  serve((path) => (path === "/images" && failures-- > 0 ? new Response("", { status: 503 }) : null));
  const store = new SceneStore("scn_1");
  await vi.waitFor(() => expect(store.connection.value).toBe("reconnecting"));
  await vi.advanceTimersByTimeAsync(1000);
  await vi.waitFor(() => expect(store.connection.value).toBe("live"));
  expect(failures).toBe(-1);
  store.close();
});

it("An older list never replaces a newer one", async () => {
  const waiting: ((response: Response) => void)[] = [];
  let held = false;
  serve((path) => (held && path === "/snapshots" ? new Promise((done) => waiting.push(done)) : null));
  const store = new SceneStore("scn_1");
  await vi.waitFor(() => expect(store.connection.value).toBe("live"));
  held = true;
  const first = store.load();
  const listOf = (id: string) => Response.json({ items: [{ id, alignment: {} }], next: null });
  await vi.waitFor(() => expect(waiting).toHaveLength(1));
  serve((path) => (path === "/snapshots" ? listOf("snp_2") : null));
  const second = store.load();
  setTimeout(() => waiting[0]?.(listOf("snp_1")), 20);
  await Promise.all([first, second]);
  expect(store.snapshots.value.map(({ id }) => id)).toEqual(["snp_2"]);
  store.close();
});
