import type { Schemas } from "../api/service";
import {
  CANDIDATES,
  type CandidatesForm,
  constraintsOf,
  type Generator,
  generatorOf,
} from "../candidates/candidates-form";
import { type Pose, poseAt, type Site, STARTS, startPose } from "../candidates/site";
import { FormError, given, numberOf } from "../candidates/values";
import type { Place } from "../store/scene";
import { strings } from "../strings";

/** Where a vehicle starts. */
export const VEHICLE_STARTS = [...STARTS, "coordinates"] as const;

export interface VehicleForm {
  start: (typeof VEHICLE_STARTS)[number];
  place: Place | null;
  /** Latitude, longitude and altitude on Earth, else x, y and z in the world frame. */
  coordinates: readonly [string, string, string];
}

export const VEHICLE: VehicleForm = { start: "last", place: null, coordinates: ["", "", ""] };

/** What the form of a plan says. */
export interface PlanForm {
  candidates: CandidatesForm;
  views: string;
  distance: string;
  home: boolean;
  vehicles: readonly VehicleForm[];
}

export const PLAN: PlanForm = {
  candidates: { ...CANDIDATES, count: "48" },
  views: "10",
  distance: "",
  home: true,
  vehicles: [VEHICLE],
};

type PlanGenerator = NonNullable<Schemas["PlanRequest"]["generator"]>;

/** Candidates in place of those of a form. */
export type From =
  | Required<Pick<Schemas["PlanRequest"], "candidates">>
  | Required<Pick<Schemas["PlanRequest"], "generator">>;

/** The request that a form describes, or with candidates from elsewhere. Throws `FormError`. */
export function planRequest(
  form: PlanForm,
  site: Site,
  snapshotId: string | null,
  from: From | null = null,
): Schemas["PlanRequest"] {
  const distance_m = numberOf(form.distance);
  const views = numberOf(form.views);
  return {
    ...(from ?? { generator: planGenerator(generatorOf(form.candidates, site)) }),
    ...given({ views, distance_m }),
    home: form.home,
    vehicles: form.vehicles.map((vehicle) => vehiclePose(vehicle, site)),
    ...constraintsOf(form.candidates, site),
    frame: site.frames.georeferenced ? "geodetic" : "world",
    ...(snapshotId !== null && { snapshot_id: snapshotId }),
  };
}

function planGenerator(generator: Generator): PlanGenerator {
  if (generator.kind === "around-current") throw new FormError(strings.plans.form.notAroundCurrent);
  return generator;
}

function vehiclePose(vehicle: VehicleForm, site: Site): Pose {
  if (vehicle.start !== "coordinates") return startPose(vehicle.start, vehicle.place, site);
  const [a, b, c] = vehicle.coordinates.map(numberOf);
  if (a === undefined || b === undefined) throw new FormError(strings.plans.form.noCoordinates);
  if (site.frames.georeferenced) return poseAt(site, { latitude_deg: a, longitude_deg: b }, c);
  return { frame: "world", position: [a, b, c ?? 0], orientation_wxyz: [1, 0, 0, 0] };
}
