import type { Schemas } from "../api/service";

/** How a model grew: one entry for each update, the oldest first. */
export interface Growth {
  snapshots: readonly Schemas["Snapshot"][];
  psnr_db: (number | null)[];
  gaussians: number[];
  points: number[];
}

/** Whether a snapshot of a list, the newest first, is the preview that an update wrote before its model. */
export function isPreview(one: Schemas["Snapshot"], snapshots: readonly Schemas["Snapshot"][]): boolean {
  return snapshots.find(({ job_id }) => job_id === one.job_id) !== one;
}

/** The growth that a list of snapshots, the newest first, shows; previews and fine models are no part of it. */
export function growthOf(snapshots: readonly Schemas["Snapshot"][]): Growth {
  const updates = snapshots.filter((one) => one.kind === "update" && !isPreview(one, snapshots)).toReversed();
  return {
    snapshots: updates,
    psnr_db: updates.map((one) => one.metrics.new_images_psnr_db),
    gaussians: updates.map((one) => one.metrics.gaussians),
    points: updates.map((one) => one.metrics.points),
  };
}
