import { signal } from "@preact/signals";
import { describe, expect, it } from "vitest";
import type { SceneStore } from "../store/scene";
import { MissionState } from "./mission-state";

function storeWith(georeferenced: boolean): SceneStore {
  return {
    id: `scn_${georeferenced}`,
    ranking: signal(null),
    plan: signal(null),
    drawings: signal([]),
    frames: signal({ georeferenced }),
    snapshot: signal({ alignment: { status: georeferenced ? "aligned" : "model" } }),
  } as unknown as SceneStore;
}

describe("the mission of a scene", () => {
  it("is of the photographs while there is nothing else, and of a format that can be written", () => {
    expect(new MissionState(storeWith(true)).usable()).toMatchObject({
      source: "photographs",
      format: "qgc-plan",
    });
    expect(new MissionState(storeWith(false)).usable().format).toBe("nerfstudio");
  });

  it("is of what was chosen once that is there", () => {
    const store = storeWith(true);
    const state = new MissionState(store);
    const before = state.key();
    store.plan.value = { id: "pln_1", tours: [] } as unknown as SceneStore["plan"]["value"];
    expect(state.usable().source).toBe("plan");
    expect(state.key()).not.toBe(before);
  });

  it("remembers its options", () => {
    const store = storeWith(true);
    const state = new MissionState(store);
    state.form.value = { ...state.form.value, speed: "8" };
    expect(new MissionState(store).form.value.speed).toBe("8");
  });
});
