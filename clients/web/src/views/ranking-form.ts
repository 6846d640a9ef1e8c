import type { Schemas } from "../api/service";
import { CANDIDATES, type CandidatesForm, constraintsOf, generatorOf } from "../candidates/candidates-form";
import { type Site, type Start, startPose, usualRadius } from "../candidates/site";
import { given, numberOf } from "../candidates/values";
import type { Place } from "../store/scene";

export type Method = Schemas["Capabilities"]["methods"][number];

/** What the form of a ranking says. */
export interface RankingForm {
  method: Method;
  candidates: CandidatesForm;
  /** How many photographs are to be taken next: so many are shown as pictures. */
  k: string;
  start: Start;
  /** The place that was clicked on the map. */
  place: Place | null;
  radius: string;
  rankAll: boolean;
}

export const RANKING: RankingForm = {
  method: "median-frequency",
  candidates: CANDIDATES,
  k: "8",
  start: "last",
  place: null,
  radius: "",
  rankAll: false,
};

/** The methods that plan for a number of photographs. */
const WITH_BUDGET: readonly Method[] = ["kriging", "uniform"];

/** The request that a form describes; without a snapshot it is for the newest. Throws `FormError`. */
export function rankingRequest(
  form: RankingForm,
  site: Site,
  snapshotId: string | null,
): Schemas["RankingRequest"] {
  const generator = generatorOf(form.candidates, site);
  const current_pose = startPose(form.start, form.place, site);
  const around = generator.kind === "around-current";
  const radius_m = numberOf(form.radius) ?? (around ? usualRadius(site) : undefined);
  const budget = WITH_BUDGET.includes(form.method) ? numberOf(form.k) : undefined;
  return {
    method: form.method,
    generator,
    current_pose,
    ...given({ radius_m, budget }),
    ...constraintsOf(form.candidates, site),
    ...(form.rankAll && { rank_all: true }),
    frame: site.frames.georeferenced ? "geodetic" : "world",
    ...(snapshotId !== null && { snapshot_id: snapshotId }),
  };
}
