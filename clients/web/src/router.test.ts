import { describe, expect, it } from "vitest";
import { hrefOf, parseRoute } from "./router";

describe("routes", () => {
  it("come back from their fragments", () => {
    const route = { page: "scene", sceneId: "scn_1", stage: "map", panel: "plans" } as const;
    expect(parseRoute(hrefOf(route))).toEqual(route);
    expect(parseRoute(hrefOf({ page: "scenes" }))).toEqual({ page: "scenes" });
  });

  it("have defaults where a fragment names nothing known", () => {
    expect(parseRoute("#/scenes/scn_1/nowhere")).toEqual({
      page: "scene",
      sceneId: "scn_1",
      stage: "view3d",
      panel: "photographs",
    });
    expect(parseRoute("#/unknown/%3Cb%3E")).toEqual({ page: "scenes" });
  });

  it.each(["#/scenes/%zz", "#%", "#/scenes/../../x", "#/scenes/%2e%2e%2fx", "#/scenes/<b>", "#content"])(
    "of scenes have ids: %o has none",
    (hash) => {
      expect(parseRoute(hash)).toEqual({ page: "scenes" });
    },
  );
});
