import { signal } from "@preact/signals";
import { expect, it } from "vitest";
import type { Schemas } from "../api/service";
import type { SceneStore } from "../store/scene";
import { shareCandidate, visitsOf } from "./same-view";

const pose = (x: number) => ({ frame: "model", position: [x, 0, 0], orientation_wxyz: [1, 0, 0, 0] });
const orbit = (count: number) => ({ kind: "orbit", count });

it("An id of a ranking is that of a plan only where both have the same candidates", () => {
  const ranking = {
    snapshot_id: "snp_1",
    request: { generator: orbit(24) },
    candidates: [{ id: "a", pose: pose(1) }],
  } as unknown as Schemas["Ranking"];
  const plan = (request: object, snapshot_id = "snp_1") =>
    ({ snapshot_id, request }) as unknown as Schemas["Plan"];
  expect(shareCandidate("a", ranking, plan({ generator: orbit(24) }))).toBe(true);
  expect(shareCandidate("a", ranking, plan({ generator: orbit(48) }))).toBe(false);
  expect(shareCandidate("a", ranking, plan({ generator: orbit(24) }, "snp_2"))).toBe(false);
  expect(shareCandidate("a", ranking, plan({ candidates: [{ id: "a", pose: pose(1) }] }))).toBe(true);
  expect(shareCandidate("a", ranking, plan({ candidates: [{ id: "a", pose: pose(2) }] }))).toBe(false);
  expect(shareCandidate("a", ranking, null)).toBe(false);
});

it("A report is about a view only where its place is the same", () => {
  const visit = (x: number) => ({ vehicle: `drone-${x}`, candidate_id: "a", pose: pose(x) });
  const store = {
    frames: signal({ cameraInModel: ({ position }: { position: number[] }) => ({ position }) }),
    cameras: signal({ centre: [0, 0, 0] }),
    visits: signal([visit(10), visit(10.05), visit(11)]),
  } as unknown as SceneStore;
  const found = visitsOf(store, "a", pose(10) as Schemas["RankedCandidate"]["pose"]);
  expect(found.map(({ vehicle }) => vehicle)).toEqual(["drone-10", "drone-10.05"]);
});
