import { expect, it } from "vitest";
import { perScene } from "./per-scene";
import type { SceneStore } from "./scene";

it("State is made once for each scene", () => {
  const [one, other] = [{ id: "a" }, { id: "b" }] as SceneStore[] as [SceneStore, SceneStore];
  const stateOf = perScene((store) => ({ of: store.id }));
  expect(stateOf(one)).toBe(stateOf(one));
  expect(stateOf(other).of).toBe("b");
});
