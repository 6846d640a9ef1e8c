import type { Schemas } from "../api/service";
import type { Place } from "../store/scene";
import { strings } from "../strings";
import { CANDIDATES, type CandidatesForm, constraintsOf, generatorOf } from "./candidates-form";
import { FormError, given, numberOf } from "./fields";
import { lastImage, type Pose, poseAt, poseOfImage, type Site, usualRadius } from "./site";

export type Method = Schemas["Capabilities"]["methods"][number];

/** From where distances are measured. */
export const STARTS = ["last", "selected", "place"] as const;
export type Start = (typeof STARTS)[number];

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

/** Where a camera is now. Throws `FormError`. */
export function startPose(start: Start, place: Place | null, site: Site): Pose {
  if (start === "place") {
    if (!place) throw new FormError(strings.views.form.noPlace);
    return poseAt(site, place);
  }
  const digest = start === "selected" ? site.selected : lastImage(site);
  const pose = digest && poseOfImage(site, digest);
  if (!pose) throw new FormError(strings.views.form.noImage);
  return pose;
}
