import type { SnapshotCameras, Triple } from "../api/artifacts";
import type { Schemas } from "../api/service";
import type { Frames } from "../geometry/frames";
import { add, cross, dot, length, minus, rotate, times, unit } from "../geometry/vectors";
import type { Drawing, Place, SceneStore } from "../store/scene";
import { strings } from "../strings";
import { FormError } from "./values";

export type Pose = Schemas["FramePose"] | Schemas["VehiclePose"];

/** What forms need to know of a scene that has a model. */
export interface Site {
  frames: Frames;
  cameras: SnapshotCameras;
  images: ReadonlyMap<string, Schemas["Image"]>;
  drawings: readonly Drawing[];
  origin: Schemas["OriginOutput"] | null;
  /** The selected image, by digest. */
  selected: string | null;
}

/** The site of the shown snapshot; null before there is a model. */
export function siteOf(store: SceneStore): Site | null {
  const frames = store.frames.value;
  const cameras = store.cameras.value;
  const selection = store.selection.value;
  if (!frames || !cameras) return null;
  return {
    frames,
    cameras,
    images: store.imageByDigest.value,
    drawings: store.drawings.value,
    origin: store.scene.value?.origin ?? null,
    selected: selection?.kind === "image" ? selection.digest : null,
  };
}

/** Whether lengths are metres; otherwise they are in the unit of the model. */
export function metric(store: SceneStore): boolean {
  return (store.snapshot.value?.alignment.status ?? "model") !== "model";
}

/** The pose of a registered image, in the model frame; null where it has none. */
export function poseOfImage(site: Site, digest: string): Schemas["FramePose"] | null {
  const view = site.cameras.views.find((one) => one.image === digest);
  return view ? { frame: "model", position: view.position, orientation_wxyz: view.orientation_wxyz } : null;
}

/** The digests of the registered images in the order in which they were taken, or arrived. */
export function inOrder(site: Site): string[] {
  const key = (digest: string) => {
    const image = site.images.get(digest);
    return image?.captured_at ?? image?.received_at ?? "";
  };
  const number = (digest: string) => site.images.get(digest)?.number ?? 0;
  return site.cameras.views
    .map((view) => view.image)
    .sort((a, b) => key(a).localeCompare(key(b)) || number(a) - number(b));
}

/** The registered image that was taken last; null while there is none. */
export function lastImage(site: Site): string | null {
  return inOrder(site).at(-1) ?? null;
}

/** From where distances are measured. */
export const STARTS = ["last", "selected", "place"] as const;
export type Start = (typeof STARTS)[number];

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

/** The pose of a vehicle over a place on Earth: as high as the last photograph, where none is given. */
export function poseAt(site: Site, place: Place, altitude_m?: number): Schemas["VehiclePose"] {
  const altitude_datum = site.origin?.altitude_datum ?? "sea-level";
  return {
    ...place,
    altitude_m: altitude_m ?? usualAltitude(site),
    altitude_datum,
    yaw_deg: 0,
    pitch_deg: 0,
    roll_deg: 0,
  };
}

function usualAltitude(site: Site): number {
  const digest = lastImage(site);
  const view = site.cameras.views.find(({ image }) => image === digest);
  const place = view && site.frames.geodeticFromModel(view.position);
  return place?.altitude_m ?? site.origin?.altitude_m ?? 0;
}

/** A box of the world frame around the model and its photographs, larger by a share of its size. */
export function boxAround(site: Site, margin: number): Schemas["Box"] {
  const { lower, upper, views } = site.cameras;
  const up = upwards(site);
  const [along, across] = levelAxes(up);
  const axes = [along, across, up] as const;
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map(
    (bits): Triple => [
      (bits & 1 ? upper : lower)[0],
      (bits & 2 ? upper : lower)[1],
      (bits & 4 ? upper : lower)[2],
    ],
  );
  const points = [...corners, ...views.map((view) => view.position)].map((point) =>
    site.frames.worldFromModel(point),
  );
  let centre: Triple = [0, 0, 0];
  const size = axes.map((axis) => {
    const along = points.map((point) => dot(point, axis));
    const [least, most] = [Math.min(...along), Math.max(...along)];
    centre = add(centre, times(axis, (least + most) / 2));
    return (most - least) * (1 + margin);
  }) as Triple;
  return { kind: "box", centre, size, along, up };
}

/** The upward direction of the model, in the world frame. */
export function upwards({ frames, cameras }: Site): Triple {
  return unit(rotate(frames.alignment.rotation_wxyz, frames.modelUp(cameras.up)));
}

/** Two level directions at right angles. */
export function levelAxes(up: Triple): readonly [Triple, Triple] {
  const axis: Triple = Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const along = unit(minus(axis, times(up, dot(axis, up))));
  return [along, cross(up, along)];
}

/** The distance of a radius around a camera in which there is something to choose: half way to the middle. */
export function usualRadius(site: Site): number {
  const centre = site.frames.worldFromModel(site.cameras.centre);
  const distances = site.cameras.views
    .map((view) => length(minus(site.frames.worldFromModel(view.position), centre)))
    .sort((a, b) => a - b);
  return (distances[Math.floor(distances.length / 2)] ?? 2) / 2;
}
