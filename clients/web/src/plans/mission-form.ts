import type { Schemas } from "../api/service";
import { fenceParameter } from "../candidates/drawing-volume";
import { FormError, numberOf } from "../candidates/values";
import type { Drawing } from "../store/scene";
import { strings } from "../strings";

export type MissionFormat = Schemas["MissionFormat"];

/** What is flown: the first views of the shown ranking, the shown plan, or all photographs again. */
export const MISSION_SOURCES = ["ranking", "plan", "photographs"] as const;
export type MissionSource = (typeof MISSION_SOURCES)[number];

/** What the form of a mission says; empty fields leave the choice to the service. */
export interface MissionForm {
  source: MissionSource;
  /** The vehicle of the plan, from 1; empty: each. */
  vehicle: string;
  first: string;
  format: MissionFormat;
  autopilot: Schemas["Autopilot"];
  drone: Schemas["Drone"];
  home: boolean;
  latitude: string;
  longitude: string;
  altitude: string;
  /** How much higher home is than where the photographs' flight took off, instead of its altitude. */
  aboveTakeoff: string;
  datum: Schemas["AltitudeDatum"] | "";
  geoid: string;
  transit: string;
  lowest: string;
  highest: string;
  speed: string;
  hold: string;
  gimbalLowest: string;
  gimbalHighest: string;
  /** The id of the drawn fence; empty: none. */
  fence: string;
  terrain: boolean;
  aboveGround: boolean;
  leaveOut: boolean;
  /** How long one battery lasts, in minutes, and the percentage of it with which the vehicle lands. */
  battery: string;
  reserve: string;
  finish: Schemas["Finish"];
}

export const MISSION: MissionForm = {
  source: "plan",
  vehicle: "",
  first: "8",
  format: "qgc-plan",
  autopilot: "ardupilot",
  drone: "m3e",
  home: false,
  latitude: "",
  longitude: "",
  altitude: "",
  aboveTakeoff: "",
  datum: "",
  geoid: "",
  transit: "",
  lowest: "",
  highest: "",
  speed: "5",
  hold: "4",
  gimbalLowest: "",
  gimbalHighest: "",
  fence: "",
  terrain: false,
  aboveGround: false,
  leaveOut: true,
  battery: "",
  reserve: "30",
  finish: "return",
};

const WORLD_FORMATS: readonly MissionFormat[] = ["ros-posearray", "ros-posestamped", "nerfstudio"];
const MAVLINK: readonly MissionFormat[] = ["qgc-plan", "qgc-wpl"];

/** Why a format cannot be written for a scene; null where it can. */
export function objection(format: MissionFormat, georeferenced: boolean, metric: boolean): string | null {
  const texts = strings.plans.mission;
  if (format === "nerfstudio") return null;
  if (WORLD_FORMATS.includes(format)) return metric ? null : texts.needsMetres;
  return georeferenced ? null : texts.needsEarth;
}

/** Whether a format is flown: it has a home, heights and speeds. */
export function isFlown(format: MissionFormat): boolean {
  return !WORLD_FORMATS.includes(format);
}

/** Whether a format is of MAVLink commands, which depend on the autopilot. */
export function isMavlink(format: MissionFormat): boolean {
  return MAVLINK.includes(format);
}

/** The parameters of a mission's request. Throws `FormError`. */
export function missionQuery(form: MissionForm, drawings: readonly Drawing[], part: number): URLSearchParams {
  const query = new URLSearchParams({ format: form.format });
  const add = (name: string, value: string | number | undefined) => {
    if (value !== undefined && value !== "") query.set(name, String(value));
  };
  if (form.source === "ranking") add("first", numberOf(form.first));
  if (form.leaveOut) add("leave_out", "true");
  if (!isFlown(form.format)) return query;
  if (form.home) {
    const latitude = numberOf(form.latitude);
    const longitude = numberOf(form.longitude);
    if (latitude === undefined || longitude === undefined) throw new FormError(strings.plans.mission.noHome);
    add("home_latitude_deg", latitude);
    add("home_longitude_deg", longitude);
    const aboveTakeoff = numberOf(form.aboveTakeoff);
    if (aboveTakeoff === undefined) add("home_altitude_m", numberOf(form.altitude));
    add("home_above_takeoff_m", aboveTakeoff);
  }
  add("altitude_datum", form.datum);
  add("geoid_height_m", numberOf(form.geoid));
  add("transit_height_m", numberOf(form.transit));
  add("lowest_height_m", numberOf(form.lowest));
  add("highest_height_m", numberOf(form.highest));
  add("speed_m_s", numberOf(form.speed));
  add("hold_s", numberOf(form.hold));
  add("gimbal_lowest_deg", numberOf(form.gimbalLowest));
  add("gimbal_highest_deg", numberOf(form.gimbalHighest));
  const battery = numberOf(form.battery);
  const reserve = numberOf(form.reserve);
  if (battery !== undefined) {
    add("battery_s", 60 * battery);
    add("battery_reserve", reserve === undefined ? undefined : reserve / 100);
  }
  add("finish", form.finish);
  if (isMavlink(form.format)) add("autopilot", form.autopilot);
  if (form.format === "mavsdk") add("autopilot", "px4");
  if (form.format === "dji-kmz") add("drone", form.drone);
  if (form.terrain && form.aboveGround) add("above_ground", "true");
  const fence = drawings.find(({ id, use }) => use === "fence" && id === form.fence);
  if (fence) add("geofence", fenceParameter(fence));
  if (part > 1) add("part", part);
  return query;
}

/** A request for a mission: its path, and its body where it has one. */
export interface MissionCall {
  path: string;
  body: Schemas["MissionRequest"] | null;
}

/** What a mission is made of. */
export interface MissionMaterial {
  sceneId: string;
  ranking: Schemas["Ranking"] | null;
  plan: Schemas["Plan"] | null;
  drawings: readonly Drawing[];
}

/**
 * The request for a part of a mission. Throws `FormError`.
 *
 * Rankings and plans have missions of their own; only views in a body can have a terrain.
 */
export function missionCall(form: MissionForm, material: MissionMaterial, part: number): MissionCall {
  const query = missionQuery(form, material.drawings, part);
  const texts = strings.plans.mission;
  const { ranking, plan } = material;
  const terrain = form.terrain && isFlown(form.format) ? { terrain: { kind: "points" as const } } : null;
  const scene = (body: Schemas["MissionRequest"]) => {
    query.delete("first");
    return { path: `/v1/scenes/${material.sceneId}/missions?${query}`, body: { ...body, ...terrain } };
  };
  if (form.source === "photographs") return scene({ all_images: true });
  if (form.source === "ranking") {
    if (!ranking) throw new FormError(texts.noRanking);
    if (!terrain) return { path: `/v1/rankings/${ranking.id}/mission?${query}`, body: null };
    const ranked = ranking.candidates.filter(({ rank }) => rank !== null);
    const first = ranked.slice(0, numberOf(form.first));
    return scene({ views: first.map(({ id, pose }) => ({ id, pose })), snapshot_id: ranking.snapshot_id });
  }
  if (!plan) throw new FormError(texts.noPlan);
  if (!terrain) {
    query.set("vehicle", form.vehicle);
    return { path: `/v1/plans/${plan.id}/mission?${query}`, body: null };
  }
  const tour = plan.tours.find(({ vehicle }) => String(vehicle) === form.vehicle);
  if (!tour) throw new FormError(texts.noPlan);
  const views = tour.stops.map(({ id, pose, via }) => ({ id, pose, via }));
  return scene({ views, via_home: tour.via_home, snapshot_id: plan.snapshot_id });
}
