import type { Schemas } from "../api/service";
import { length, minus } from "../geometry/vectors";
import type { SceneStore } from "../store/scene";

const SHARE = 0.01;

/**
 * Whether an id names the same view in a ranking and in a plan.
 *
 * An id names a pose within one result only: another count of an orbit gives the same ids to other poses.
 */
export function shareCandidate(
  id: string,
  ranking: Schemas["Ranking"] | null,
  plan: Schemas["Plan"] | null,
): boolean {
  if (!ranking || !plan) return false;
  const listed = plan.request.candidates?.find((one) => one.id === id);
  const ranked = ranking.candidates.find((one) => one.id === id);
  if (listed) return JSON.stringify(listed.pose) === JSON.stringify(ranked?.pose);
  const generated = plan.request.generator ?? null;
  const same = JSON.stringify(generated) === JSON.stringify(ranking.request.generator ?? null);
  return generated !== null && same && plan.snapshot_id === ranking.snapshot_id;
}

/** What vehicles report about a view, by its id and its place. */
export function visitsOf(
  store: SceneStore,
  id: string,
  pose: Schemas["RankedCandidate"]["pose"],
): readonly Schemas["Visit"][] {
  const frames = store.frames.value;
  const centre = store.cameras.value?.centre;
  const here = frames?.cameraInModel(pose)?.position;
  if (!frames || !centre || !here) return [];
  const reach = SHARE * length(minus(here, centre));
  return store.visits.value.filter((visit) => {
    const there = visit.candidate_id === id && frames.cameraInModel(visit.pose)?.position;
    return there && length(minus(there, here)) <= reach;
  });
}
