import type { Schemas } from "../api/service";

/** How a model grew: one entry for each update, the oldest first. */
export interface Growth {
  snapshots: readonly Schemas["Snapshot"][];
  psnr_db: (number | null)[];
  gaussians: number[];
  points: number[];
}

/** The growth that a list of snapshots, the newest first, shows; fine models are no part of it. */
export function growthOf(snapshots: readonly Schemas["Snapshot"][]): Growth {
  const updates = snapshots.filter((one) => one.kind === "update").toReversed();
  return {
    snapshots: updates,
    psnr_db: updates.map((one) => one.metrics.new_images_psnr_db),
    gaussians: updates.map((one) => one.metrics.gaussians),
    points: updates.map((one) => one.metrics.points),
  };
}
