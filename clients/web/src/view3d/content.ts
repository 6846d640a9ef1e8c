import type { PinholeIntrinsics, Quaternion, Triple } from "../api/artifacts";
import type { Schemas } from "../api/service";
import { isGeodetic } from "../geometry/earth";
import { type Camera, Frames } from "../geometry/frames";
import { multiply } from "../geometry/vectors";
import type { SceneStore, Selection } from "../store/scene";
import { strings } from "../strings";
import { DEFAULT_INTRINSICS } from "./lens";

/** What can be shown or hidden. */
export const LAYERS = [
  "splat",
  "points",
  "images",
  "unregistered",
  "candidates",
  "visits",
  "route",
  "forecast",
  "grid",
] as const;
export type Layer = (typeof LAYERS)[number];

/** Why a marker has its colour; the themes say which. */
export type Paint =
  | { kind: "registered" | "unregistered" | "unranked" | "taken" | "going-to" | "failed" }
  | { kind: "rank"; value: number }
  | { kind: "vehicle"; number: number };

/** A camera in the view: a frustum, or a point where only its position is known. */
export interface Marker {
  layer: Layer;
  position: Triple;
  orientation: Quaternion | null;
  paint: Paint;
  label: string;
  selects: Selection | null;
}

/** The way of a vehicle, and its stops with their numbers. */
export interface Route {
  vehicle: number;
  way: Triple[];
  stops: { number: number; position: Triple }[];
}

/** What the view shows besides splat and points, in the frame of the shown model. */
export interface Content {
  intrinsics: PinholeIntrinsics;
  up: Triple;
  /** North in the model frame; null in scenes without a place on Earth. */
  north: Triple | null;
  /** Metres per unit; null where lengths have no unit. */
  metres: number | null;
  centre: Triple;
  /** The radius around the centre in which the cameras and the model's box are. */
  radius: number;
  markers: readonly Marker[];
  routes: readonly Route[];
}

const NOT_ALIGNED: Schemas["Alignment"] = {
  status: "model",
  source: "positions",
  scale: 1,
  rotation_wxyz: [1, 0, 0, 0],
  translation: [0, 0, 0],
  rms_m: null,
  inliers: 0,
  positions: 0,
  takeoff_altitude_m: null,
};

/** The frames of what is shown: those of the snapshot, before there is one those of the position priors. */
export function framesOf(store: SceneStore): Frames {
  const found = store.frames.value;
  if (found) return found;
  const origin =
    store.scene.value?.origin ?? placeOf(store.images.value.find((one) => placeOf(one.prior))?.prior);
  return new Frames(NOT_ALIGNED, origin ?? null);
}

/** Everything of a scene that has a place in the view. */
export function contentOf(store: SceneStore): Content {
  const frames = framesOf(store);
  const cameras = store.cameras.value;
  const registered = imageMarkers(store);
  const known = new Set(cameras?.views.map((view) => view.image));
  const aligned = cameras === null || frames.alignment.status !== "model";
  const markers = [
    ...registered,
    ...(aligned ? priorMarkers(store, frames, known) : []),
    ...candidateMarkers(store, frames),
    ...visitMarkers(store, frames),
  ];
  const { routes, stops } = plannedRoutes(store, frames);
  markers.push(...stops);
  const box = cameras
    ? [cameras.lower, cameras.upper, ...cameras.views.map((view) => view.position)]
    : markers.map((marker) => marker.position);
  const { centre, radius } = sphereOf(box);
  return {
    intrinsics: cameras?.camera ?? DEFAULT_INTRINSICS,
    up: cameras ? frames.modelUp(cameras.up) : [0, 0, 1],
    north: frames.georeferenced || (!cameras && frames.enu) ? northOf(frames) : null,
    metres: frames.alignment.status !== "model" ? frames.alignment.scale : null,
    centre: cameras?.centre ?? centre,
    radius,
    markers,
    routes,
  };
}

/** The middle of a box around points, and the radius of a sphere around it; 1 around fewer than two points. */
export function sphereOf(points: readonly Triple[]): { centre: Triple; radius: number } {
  if (points.length === 0) return { centre: [0, 0, 0], radius: 1 };
  const ends = [0, 1, 2].map((axis) => {
    const values = points.map((point) => point[axis] as number);
    return [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))] as const;
  });
  const centre = ends.map(([low, high]) => (low + high) / 2) as Triple;
  const radius = Math.hypot(...ends.map(([low, high]) => (high - low) / 2));
  return { centre, radius: radius || 1 };
}

function northOf(frames: Frames): Triple {
  const { rotation_wxyz } = frames.alignment;
  const [w, x, y, z] = rotation_wxyz;
  // The second row of the rotation world_from_model.
  return [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)];
}

function imageMarkers(store: SceneStore): Marker[] {
  return (store.cameras.value?.views ?? []).map((view) => ({
    layer: "images",
    position: view.position,
    orientation: view.orientation_wxyz,
    paint: { kind: "registered" },
    label: view.name,
    selects: { kind: "image", digest: view.image },
  }));
}

function priorMarkers(store: SceneStore, frames: Frames, known: ReadonlySet<string>): Marker[] {
  const markers: Marker[] = [];
  for (const image of store.images.value) {
    if (known.has(image.digest) || image.verdict !== "accepted") continue;
    const camera = priorCamera(image.prior, frames);
    if (!camera) continue;
    markers.push({
      layer: "unregistered",
      ...camera,
      paint: { kind: "unregistered" },
      label: `${image.name}: ${strings.photographs.registrations[image.registration]}`,
      selects: { kind: "image", digest: image.digest },
    });
  }
  return markers;
}

function placeOf(prior: Schemas["Prior"] | null | undefined) {
  if (prior?.latitude_deg == null || prior.longitude_deg == null) return null;
  const { latitude_deg, longitude_deg } = prior;
  return { latitude_deg, longitude_deg, altitude_m: prior.altitude_m ?? 0 };
}

function priorCamera(
  prior: Schemas["Prior"] | null,
  frames: Frames,
):
  | (Omit<Camera, "orientation"> & {
      orientation: Quaternion | null;
    })
  | null {
  const place = placeOf(prior);
  if (place && prior) {
    const yaw_deg = prior.yaw_deg;
    const pose = { ...place, altitude_datum: "sea-level" as const, yaw_deg: yaw_deg ?? 0 };
    const camera = frames.cameraInModel({
      ...pose,
      pitch_deg: prior.pitch_deg ?? 0,
      roll_deg: prior.roll_deg ?? 0,
    });
    return camera && (yaw_deg == null ? { ...camera, orientation: null } : camera);
  }
  if (prior?.x_m == null || prior.y_m == null || prior.z_m == null) return null;
  return { position: frames.modelFromWorld([prior.x_m, prior.y_m, prior.z_m]), orientation: null };
}

/** The cameras of poses in the shown model; those of another snapshot come through the world, which both share. */
export function placedBy(
  owner: { snapshot_id: string; alignment: Schemas["Alignment"]; origin: Schemas["OriginOutput"] | null },
  store: SceneStore,
  frames: Frames,
): (pose: Schemas["FramePose"] | Schemas["VehiclePose"]) => Camera | null {
  if (owner.snapshot_id === store.snapshot.value?.id) return (pose) => frames.cameraInModel(pose);
  const theirs = new Frames(owner.alignment, owner.origin);
  return (pose) => {
    if (isGeodetic(pose) || pose.frame !== "model") return frames.cameraInModel(pose);
    return frames.cameraInModel({
      frame: "world",
      position: theirs.worldFromModel(pose.position),
      orientation_wxyz: multiply(theirs.alignment.rotation_wxyz, pose.orientation_wxyz),
    });
  };
}

function candidateMarkers(store: SceneStore, frames: Frames): Marker[] {
  const ranking = store.ranking.value;
  if (!ranking) return [];
  const place = placedBy(ranking, store, frames);
  const last = Math.max(1, ...ranking.candidates.map((one) => (one.rank ?? 1) - 1));
  const markers: Marker[] = [];
  for (const one of ranking.candidates) {
    const camera = place(one.pose);
    if (!camera) continue;
    markers.push({
      layer: "candidates",
      ...camera,
      paint: one.rank === null ? { kind: "unranked" } : { kind: "rank", value: (one.rank - 1) / last },
      label:
        one.rank === null
          ? strings.view3d.unranked(one.id, strings.views.statuses[one.status])
          : strings.view3d.ranked(one.id, one.rank),
      selects: { kind: "candidate", id: one.id },
    });
  }
  return markers;
}

function visitMarkers(store: SceneStore, frames: Frames): Marker[] {
  const markers: Marker[] = [];
  for (const visit of store.visits.value) {
    const camera = frames.cameraInModel(visit.pose);
    if (!camera) continue;
    markers.push({
      layer: "visits",
      ...camera,
      paint: { kind: visit.state },
      label: strings.view3d.visit(visit.candidate_id, visit.vehicle, strings.views.card.visits[visit.state]),
      selects: { kind: "candidate", id: visit.candidate_id },
    });
  }
  return markers;
}

function plannedRoutes(store: SceneStore, frames: Frames): { routes: Route[]; stops: Marker[] } {
  const plan = store.plan.value;
  if (!plan) return { routes: [], stops: [] };
  const place = placedBy(plan, store, frames);
  const stops: Marker[] = [];
  const routes = plan.tours.map((tour): Route => {
    const route: Route = { vehicle: tour.vehicle, way: [], stops: [] };
    const pass = (pose: Schemas["FramePose"] | Schemas["VehiclePose"]) => {
      const camera = place(pose);
      if (camera) route.way.push(camera.position);
      return camera;
    };
    const start = plan.request.vehicles?.[tour.vehicle - 1];
    if (start) pass(start);
    for (const [index, stop] of tour.stops.entries()) {
      stop.via.map(pass);
      const camera = pass(stop.pose);
      if (!camera) continue;
      route.stops.push({ number: index + 1, position: camera.position });
      stops.push({
        layer: "route",
        ...camera,
        paint: { kind: "vehicle", number: tour.vehicle },
        label: strings.view3d.stop(index + 1, tour.vehicle, stop.id),
        selects: { kind: "stop", id: stop.id },
      });
    }
    tour.via_home.map(pass);
    if (start && plan.request.home && tour.stops.length) pass(start);
    return route;
  });
  return { routes: routes.filter((route) => route.way.length > 0), stops };
}
