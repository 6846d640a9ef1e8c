import { describe, expect, it } from "vitest";
import type { Quaternion, SnapshotCameras, Triple } from "../api/artifacts";
import { add, multiply, rotate, times } from "../geometry/vectors";
import { carried } from "./carry";
import { posesIn } from "./compared-poses";
import { lookAt } from "./viewpoint";

const TURN: Quaternion = [Math.SQRT1_2, 0, Math.SQRT1_2, 0];
const moved = (point: Triple): Triple => add(times(rotate(TURN, point), 3), [5, -1, 2]);

function cameras(places: Record<string, Triple>): SnapshotCameras {
  return {
    camera: { width_px: 640, height_px: 480, fx_px: 400, fy_px: 400, cx_px: 320, cy_px: 240 },
    views: Object.entries(places).map(([image, position]) => ({
      image,
      name: image,
      position,
      orientation_wxyz: [0.6, 0, 0.8, 0],
      counted_share: 1,
    })),
    centre: [0, 0, 0],
    up: [0, 0, 1],
    lower: [-1, -1, -1],
    upper: [1, 1, 1],
  };
}

const before = cameras({ a: [0, 0, 0], b: [1, 0, 0], c: [0, 2, 0] });
const after = {
  ...before,
  views: before.views.map((view) => ({
    ...view,
    position: moved(view.position),
    orientation_wxyz: multiply(TURN, view.orientation_wxyz),
  })),
};

function close(actual: readonly number[], expected: readonly number[]): void {
  actual.forEach((part, index) => {
    expect(part).toBeCloseTo(expected[index] as number, 9);
  });
}

describe("a viewpoint carried to another model", () => {
  const view = lookAt([2, 1, 4], [0, 0, 0], [0, 0, 1]);

  it("goes along with a similarity of the models", () => {
    const found = carried(view, before, after);
    if (!found) throw new Error("the models share cameras");
    close(found.position, moved(view.position));
    close(rotate(found.orientation, [0, 0, 1]), rotate(TURN, rotate(view.orientation, [0, 0, 1])));
    expect(found.distance).toBeCloseTo(3 * view.distance, 9);
  });

  it("is lost where the models share no cameras", () => {
    expect(carried(view, before, cameras({ x: [0, 0, 0], y: [1, 1, 1] }))).toBeNull();
  });
});

describe("the poses of a comparison", () => {
  it("are those of a photograph in each model, also if only one has it", () => {
    const poses = posesIn(before, after, "b", null);
    close(poses?.[0].position ?? [], [1, 0, 0]);
    close(poses?.[1].position ?? [], moved([1, 0, 0]));
    const grown = {
      ...after,
      views: [...after.views, { ...after.views[0], image: "new", position: [5, -1, 5] }],
    };
    close(posesIn(before, grown as SnapshotCameras, "new", null)?.[0].position ?? [], rotated([0, 0, 3]));
  });

  it("are none of a photograph that neither model has", () => {
    expect(posesIn(before, after, "z", null)).toBeNull();
  });
});

/** A difference of positions of the second model in the first. */
function rotated(difference: Triple): Triple {
  const [w, x, y, z] = TURN;
  return times(rotate([w, -x, -y, -z], difference), 1 / 3);
}
