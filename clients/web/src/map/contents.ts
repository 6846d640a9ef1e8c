import { computed, effect, signal } from "@preact/signals";
import { loadTerrain, type PinholeIntrinsics, type Terrain } from "../api/artifacts";
import type { Schemas } from "../api/service";
import { type Camera, poseOf } from "../geometry/frames";
import { report } from "../store/notices";
import type { SceneStore } from "../store/scene";
import { footprintOf, lensOf } from "./footprints";
import { forecastGrid } from "./forecast-grid";
import { type Ground, groundOf, levelGround } from "./ground";
import { overlapOf } from "./ground-grid";
import { shownLayers } from "./layers";
import { MapFrame } from "./map-frame";
import type { Flat } from "./polygons";
import { type Outline, outlineOf } from "./volume-outline";

/** A photograph on the map: where its camera is by the model or, before that, by its position prior. */
export interface PlacedPhotograph {
  digest: string;
  at: Flat;
  /** Its camera, where the orientation is known. */
  camera: Camera | null;
  registration: Schemas["Registration"];
}

export interface PlacedCandidate {
  id: string;
  at: Flat;
  /** The direction of the camera's view on the map; short for one that looks down. */
  towards: Flat;
  rank: number | null;
  status: Schemas["CandidateStatus"];
}

/** The way of one vehicle: its stops in order, and the corners of the whole way from where it starts. */
export interface PlacedTour {
  vehicle: number;
  start: Flat | null;
  way: Flat[];
  stops: { id: string; at: Flat }[];
}

const LEAST_ABOVE = 10;

const flatOf = ({ position }: Camera): Flat => [position[0], position[1]];

/** What the map shows of a scene, in the frame of the map; it follows the scene. */
export class MapContents {
  /** How high the first photograph was taken above the ground, as the operator says before there is a model. */
  readonly flightHeight = signal<number | null>(null);
  private readonly terrain = signal<Terrain | null>(null);
  private readonly stop: () => void;

  constructor(readonly store: SceneStore) {
    this.stop = effect(() => void this.loadTerrain(this.snapshotId.value));
  }

  /** No longer follow the scene. */
  close(): void {
    this.stop();
  }

  private readonly snapshotId = computed(() => this.store.snapshot.value?.id ?? null);
  private readonly origin = computed(() => JSON.stringify(this.store.scene.value?.origin ?? null));

  /** It stays the same while scene and snapshot have the same place: all else depends on it. */
  readonly frame = computed(() => {
    void this.snapshotId.value;
    const origin = JSON.parse(this.origin.value) as Schemas["OriginOutput"] | null;
    return new MapFrame(this.store.frames.peek(), origin, this.store.cameras.value?.up ?? null);
  });

  /** The ground by the model, else by what is known of altitudes; null when nothing is. */
  readonly ground = computed((): Ground | null => {
    const frame = this.frame.value;
    const terrain = this.terrain.value && groundOf(this.terrain.value, frame);
    if (terrain) return terrain;
    const { cameras, scene } = this.store;
    if (cameras.value) {
      const middle = frame.ofModel({ position: cameras.value.centre, orientation: [1, 0, 0, 0] });
      if (middle) return levelGround(middle.position[2]);
    }
    if (this.flightHeight.value !== null) return levelGround(-this.flightHeight.value);
    const origin = scene.value?.origin;
    return origin?.altitude_datum === "takeoff" ? levelGround(-origin.altitude_m) : null;
  });

  /** Whether the ground is where the operator says. */
  readonly groundIsAssumed = computed(
    () =>
      this.flightHeight.value !== null && this.terrain.value === null && this.store.cameras.value === null,
  );

  /** The photographs that have a place, in the order in which they were taken. */
  readonly photographs = computed((): PlacedPhotograph[] => {
    const frame = this.frame.value;
    const views = new Map(this.store.cameras.value?.views.map((view) => [view.image, view]));
    const images = this.store.images.value.filter((image) => image.verdict === "accepted");
    const timed = images.every((image) => image.captured_at !== null);
    const order = (image: Schemas["Image"]) => (timed ? (image.captured_at as string) : "");
    const sorted = [...images].sort((a, b) => order(a).localeCompare(order(b)) || a.number - b.number);
    return sorted.flatMap((image) => {
      const view = views.get(image.digest);
      const registered =
        view && frame.ofModel({ position: view.position, orientation: view.orientation_wxyz });
      const camera = registered ?? this.priorCamera(image.prior);
      const at = camera ? flatOf(camera) : this.priorPlace(image.prior);
      return at === null ? [] : [{ digest: image.digest, at, camera, registration: image.registration }];
    });
  });

  /** The usual height of the cameras, and how far that is above the ground. */
  readonly flight = computed(() => {
    const heights = this.photographs.value
      .flatMap(({ camera }) => (camera ? [camera.position[2]] : []))
      .sort((a, b) => a - b);
    const ground = this.ground.value?.typical ?? 0;
    const height = heights[heights.length >> 1] ?? ground + 50;
    return { height, above: Math.max(LEAST_ABOVE, height - ground) };
  });

  /** What each photograph sees of the ground, of those whose orientation is known. */
  readonly footprints = computed(() => {
    const ground = this.ground.value;
    if (ground === null) return [];
    return this.photographs.value.flatMap(({ digest, camera, registration }) => {
      const lens = camera && this.lensOf(digest);
      const corners = lens && footprintOf(camera, lens, ground);
      return corners ? [{ digest, corners, registered: registration === "registered" }] : [];
    });
  });

  readonly overlap = computed(() => overlapOf(this.footprints.value.map((one) => one.corners)));

  /** What the model does not know, over the ground. */
  readonly forecast = computed(() => {
    const forecast = this.store.forecast.value;
    const samples = forecast?.samples.flatMap((sample) => {
      const camera = this.frame.value.ofPose(poseOf(sample), forecast.alignment);
      return camera ? [{ ...sample, at: flatOf(camera) }] : [];
    });
    return forecastGrid(samples ?? []);
  });

  readonly candidates = computed((): PlacedCandidate[] => {
    const ranking = this.store.ranking.value;
    if (ranking === null) return [];
    return ranking.candidates.flatMap(({ id, rank, status, pose }) => {
      const camera = this.frame.value.ofPose(pose, ranking.alignment);
      return camera ? [{ id, at: flatOf(camera), towards: viewDirection(camera), rank, status }] : [];
    });
  });

  /** Where the vehicle of the ranking is, and how far from it candidates are. */
  readonly reach = computed(() => {
    const ranking = this.store.ranking.value;
    const { current_pose: pose, radius_m: radius } = ranking?.request ?? {};
    const camera = pose ? this.frame.value.ofPose(pose, ranking?.alignment) : null;
    return camera && { at: flatOf(camera), radius: radius ?? null };
  });

  readonly tours = computed((): PlacedTour[] => {
    const plan = this.store.plan.value;
    if (plan === null) return [];
    const place = (pose: Schemas["Stop"]["pose"]): Flat[] => {
      const camera = this.frame.value.ofPose(pose, plan.alignment);
      return camera ? [flatOf(camera)] : [];
    };
    return plan.tours.map(({ vehicle, stops, via_home }) => {
      const given = plan.request.vehicles?.[vehicle - 1];
      const start = given
        ? (place(given)[0] ?? null)
        : plan.request.vehicles
          ? null
          : this.lastPhotograph(plan);
      const way = stops.flatMap((stop) => [...stop.via.flatMap(place), ...place(stop.pose)]);
      const back = plan.request.home && start ? [...via_home.flatMap(place), start] : [];
      return {
        vehicle,
        start,
        way: [...(start ? [start] : []), ...way, ...back],
        stops: stops.flatMap((stop) => place(stop.pose).map((at) => ({ id: stop.id, at }))),
      };
    });
  });

  readonly visits = computed(() =>
    this.store.visits.value.flatMap(({ vehicle, state, pose, candidate_id }) => {
      const camera = this.frame.value.ofPose(pose);
      return camera ? [{ vehicle, state, id: candidate_id, at: flatOf(camera) }] : [];
    }),
  );

  /** The volumes of the shown ranking and plan that nothing may enter. */
  readonly noFly = computed((): Outline[] => {
    const requests = [this.store.ranking.value?.request, this.store.plan.value?.request];
    return requests.flatMap((request) =>
      (request?.no_fly ?? []).flatMap((volume) => {
        const outline = outlineOf(volume, (point) => this.frame.value.ofWorld(point));
        return outline ? [outline] : [];
      }),
    );
  });

  /** The corners of each drawing. */
  readonly drawings = computed(() =>
    this.store.drawings.value.map((drawing) => ({ drawing, corners: this.cornersOf(drawing.corners) })),
  );

  /** All that is painted. */
  readonly painted = computed(() => ({
    photographs: this.photographs.value,
    footprints: this.footprints.value,
    overlap: shownLayers.value.has("overlap") ? this.overlap.value : null,
    forecast: this.forecast.value,
    candidates: this.candidates.value,
    reach: this.reach.value,
    tours: this.tours.value,
    visits: this.visits.value,
    noFly: this.noFly.value,
    drawings: this.drawings.value,
  }));

  /** Points that a view of everything shows. */
  readonly everything = computed((): Flat[] => [
    ...this.photographs.value.map((one) => one.at),
    ...this.footprints.value.flatMap((one) => one.corners),
    ...this.candidates.value.map((one) => one.at),
    ...this.tours.value.flatMap((one) => one.way),
    ...this.drawings.value.flatMap((one) => one.corners),
  ]);

  cornersOf(places: readonly { latitude_deg: number; longitude_deg: number }[]): Flat[] {
    const altitude_m = this.store.scene.value?.origin?.altitude_m ?? 0;
    return places.flatMap((place): Flat[] => {
      const point = this.frame.value.ofPlace({ ...place, altitude_m });
      return point ? [[point[0], point[1]]] : [];
    });
  }

  /** Where a plan's vehicle is that was not given: at the last registered image. */
  private lastPhotograph(plan: Schemas["Plan"]): Flat | null {
    const view =
      plan.snapshot_id === this.snapshotId.value ? this.store.cameras.value?.views.at(-1) : undefined;
    return this.photographs.value.find((one) => one.digest === view?.image)?.at ?? null;
  }

  private lensOf(digest: string): PinholeIntrinsics | null {
    const camera = this.store.cameras.value?.camera;
    if (camera) return camera;
    const image = this.store.imageByDigest.value.get(digest);
    const { width_px, height_px, focal_length_px } = image ?? {};
    return width_px && height_px && focal_length_px ? lensOf(width_px, height_px, focal_length_px) : null;
  }

  private priorPlace(prior: Schemas["Prior"] | null): Flat | null {
    const { latitude_deg, longitude_deg, x_m, y_m, z_m } = prior ?? {};
    if (latitude_deg != null && longitude_deg != null)
      return this.cornersOf([{ latitude_deg, longitude_deg }])[0] ?? null;
    const point = x_m != null && y_m != null ? this.frame.value.ofWorld([x_m, y_m, z_m ?? 0]) : null;
    return point && [point[0], point[1]];
  }

  /** The camera by a prior that has an altitude, above the datum of the scene's, and angles. */
  private priorCamera(prior: Schemas["Prior"] | null): Camera | null {
    const { latitude_deg, longitude_deg, altitude_m, altitude_datum, yaw_deg, pitch_deg, roll_deg } =
      prior ?? {};
    if (latitude_deg == null || longitude_deg == null || altitude_m == null || !altitude_datum) return null;
    if (yaw_deg == null || pitch_deg == null) return null;
    if (altitude_datum !== this.store.scene.value?.origin?.altitude_datum) return null;
    return this.frame.value.ofPose({
      latitude_deg,
      longitude_deg,
      altitude_m,
      altitude_datum,
      yaw_deg,
      pitch_deg,
      roll_deg: roll_deg ?? 0,
    });
  }

  private async loadTerrain(id: string | null): Promise<void> {
    try {
      const snapshot = this.store.snapshot.peek();
      const terrain = snapshot && (await loadTerrain(snapshot));
      if (this.snapshotId.value === id) this.terrain.value = terrain;
    } catch (error) {
      report(error);
    }
  }
}

function viewDirection({ orientation: [w, x, y, z] }: Camera): Flat {
  return [2 * (x * z + w * y), 2 * (y * z - w * x)]; // the level part of the camera's z axis
}
