import { expect, it } from "vitest";
import type { Schemas } from "../api/service";
import { growthOf } from "./growth-series";

it("is that of updates without their previews, the oldest first", () => {
  const snapshot = (job_id: string, kind: string, gaussians: number, psnr: number | null) =>
    ({ job_id, kind, metrics: { gaussians, points: 10, new_images_psnr_db: psnr } }) as Schemas["Snapshot"];
  const growth = growthOf([
    snapshot("c", "update", 300, 21),
    snapshot("c", "update", 30, 21),
    snapshot("b", "fine", 999, null),
    snapshot("a", "update", 100, null),
  ]);
  expect(growth.gaussians).toEqual([100, 300]);
  expect(growth.psnr_db).toEqual([null, 21]);
});
