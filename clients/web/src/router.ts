import { computed, signal } from "@preact/signals";

/** What the page shows; in the fragment of the URL, so that the service needs no routes for it. */
export type Route = { page: "scenes" } | { page: "scene"; sceneId: string; stage: Stage; panel: Panel };

export const STAGES = ["view3d", "map", "compare"] as const;
export type Stage = (typeof STAGES)[number];
export const PANELS = ["photographs", "views", "plans", "work"] as const;
export type Panel = (typeof PANELS)[number];

/** An id of the service. Other texts could lead to other paths of it. */
const ID = /^\w+$/;

const fragment = signal(location.hash);
addEventListener("hashchange", () => {
  fragment.value = location.hash;
});

export const route = computed(() => parseRoute(fragment.value));

/** The route that a fragment names; unknown ones are the list of scenes. */
export function parseRoute(hash: string): Route {
  const [noun, sceneId, stage, panel] = hash.replace(/^#\/?/, "").split("/");
  if (noun !== "scenes" || !sceneId || !ID.test(sceneId)) return { page: "scenes" };
  return {
    page: "scene",
    sceneId,
    stage: STAGES.find((one) => one === stage) ?? "view3d",
    panel: PANELS.find((one) => one === panel) ?? "photographs",
  };
}

/** The fragment of a route. */
export function hrefOf(route: Route): string {
  if (route.page === "scenes") return "#/";
  return `#/scenes/${route.sceneId}/${route.stage}/${route.panel}`;
}

export function go(to: Route): void {
  location.hash = hrefOf(to);
}

/** Show another stage or panel of the scene that is shown. */
export function show(part: { stage: Stage } | { panel: Panel }): void {
  const now = route.peek();
  if (now.page === "scene") go({ ...now, ...part });
}
