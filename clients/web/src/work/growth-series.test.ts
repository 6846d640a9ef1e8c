import { expect, it } from "vitest";
import type { Schemas } from "../api/service";
import { growthOf } from "./growth-series";

it("is that of updates, the oldest first", () => {
  const snapshot = (kind: string, gaussians: number, psnr: number | null) =>
    ({ kind, metrics: { gaussians, points: 10, new_images_psnr_db: psnr } }) as Schemas["Snapshot"];
  const growth = growthOf([
    snapshot("update", 300, 21),
    snapshot("fine", 999, null),
    snapshot("update", 100, null),
  ]);
  expect(growth.gaussians).toEqual([100, 300]);
  expect(growth.psnr_db).toEqual([null, 21]);
});
