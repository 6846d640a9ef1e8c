import { computed, effect, type Signal, signal } from "@preact/signals";
import { loadCameras, type SnapshotCameras } from "../api/artifacts";
import { type SceneEvent, sceneEvents } from "../api/events";
import { ServiceError } from "../api/problem";
import { all, api, data, type Schemas } from "../api/service";
import { type Camera, Frames } from "../geometry/frames";
import { strings } from "../strings";
import { afterEvents } from "./images";
import { keptDrawings } from "./kept-drawings";
import { report } from "./notices";
import { throttled } from "./throttle";

const RETRY_MS = 1000;
const REFRESH_MS = 300;
const PAGE = 1000;

/** What is selected in the 3D view, on the map or in a list; details of it are shown. */
export type Selection =
  | { kind: "image"; digest: string }
  | { kind: "candidate"; id: string }
  | { kind: "stop"; id: string };

/** A place on the map. */
export interface Place {
  latitude_deg: number;
  longitude_deg: number;
}

/** Something drawn on the map, at corners on Earth in order. */
export interface Drawing {
  id: string;
  /** Candidates are made in an area or along a corridor; vehicles stay inside of a fence and out of no-fly zones. */
  use: "area" | "corridor" | "fence" | "no-fly";
  corners: readonly Place[];
  /** How far a corridor reaches from its line. */
  radius_m: number;
  /** Heights above the scene's origin between which an area or a zone is. */
  lower_m: number;
  upper_m: number;
}

/** Whether events arrive: `live`, `reconnecting` after the connection broke, `ended` when the scene was deleted. */
export type Connection = "connecting" | "live" | "reconnecting" | "ended";

/**
 * A scene as the page knows it: what the service has, kept up to date by its events, and what is chosen on the page.
 *
 * Lists are the newest first, as the service has them, except for images, which are in the order of arrival.
 */
export class SceneStore {
  readonly scene = signal<Schemas["Scene"] | null>(null);
  readonly images = signal<readonly Schemas["Image"][]>([]);
  readonly jobs = signal<readonly Schemas["Job"][]>([]);
  readonly snapshots = signal<readonly Schemas["Snapshot"][]>([]);
  readonly rankings = signal<readonly Schemas["RankingSummary"][]>([]);
  readonly plans = signal<readonly Schemas["PlanSummary"][]>([]);
  readonly visits = signal<readonly Schemas["Visit"][]>([]);
  readonly connection = signal<Connection>("connecting");
  /** Why the scene cannot be shown; null while it can. */
  readonly failure = signal<ServiceError | null>(null);

  /** The id of the snapshot to show; null: the newest. */
  readonly chosenSnapshot = signal<string | null>(null);
  /** The ranking and the plan that are shown. */
  readonly ranking = signal<Schemas["Ranking"] | null>(null);
  readonly plan = signal<Schemas["Plan"] | null>(null);
  /** What the shown snapshot does not know, while that is shown: at candidates, over the ground or on its surface. */
  readonly forecast = signal<Schemas["Forecast"] | null>(null);
  /** The cameras of the shown snapshot; null while there is none. */
  readonly cameras = signal<SnapshotCameras | null>(null);
  readonly selection = signal<Selection | null>(null);
  /** Areas, corridors, fences and no-fly zones that were drawn on the map. */
  readonly drawings: Signal<readonly Drawing[]>;
  /** The id of the drawing that is chosen on the map, such as the area to fly. */
  readonly chosenDrawing = signal<string | null>(null);
  /** Gets the place of the next click on the map, in place of selecting what is there; null: nothing waits for one. */
  readonly pick = signal<((place: Place) => void) | null>(null);
  /** The camera to look through in the 3D view; the view sets it to null when the operator moves on. */
  readonly lookThrough = signal<Camera | null>(null);

  /** The shown snapshot; null before the first update. */
  readonly snapshot = computed(
    () =>
      this.snapshots.value.find((one) => one.id === this.chosenSnapshot.value) ??
      this.snapshots.value[0] ??
      null,
  );
  /** The frames of the shown snapshot; null before the first update. */
  readonly frames = computed(() => {
    const snapshot = this.snapshot.value;
    return snapshot && new Frames(snapshot.alignment, this.scene.value?.origin ?? null);
  });
  readonly imageByDigest = computed(() => new Map(this.images.value.map((image) => [image.digest, image])));
  /** The job that runs or waits; null when there is none. */
  readonly openJob = computed(
    () =>
      this.jobs.value.find((job) => job.state === "running") ??
      this.jobs.value.find((job) => job.state === "queued") ??
      null,
  );

  private readonly aborter = new AbortController();
  private readonly stopLoadingCameras: () => void;
  private readonly stale = new Set<"scene" | "images" | "snapshots" | "rankings" | "plans" | "visits">();
  private readonly staleJobs = new Set<string>();
  /** Events of images that came since their list was asked for; null while it is not. */
  private imageEvents: SceneEvent[] | null = null;
  /** What is being loaded. */
  private loading: Promise<void> = Promise.resolve();
  private readonly refresh = throttled(async () => {
    await this.reload().catch((error: unknown) => {
      if (this.connection.value === "live") report(error);
    });
  }, REFRESH_MS);

  constructor(readonly id: string) {
    this.drawings = keptDrawings(id);
    this.stopLoadingCameras = effect(() => {
      const id = this.snapshot.value?.id ?? null;
      void this.showCameras(id);
    });
    void this.follow();
  }

  /** End the connection; to be called when the page leaves the scene. */
  close(): void {
    this.stopLoadingCameras();
    this.aborter.abort();
  }

  /** Load everything again. Throws `ServiceError`. */
  async load(): Promise<void> {
    for (const name of ["scene", "images", "snapshots", "rankings", "plans", "visits"] as const)
      this.stale.add(name);
    const path = { scene_id: this.id };
    const jobs = await data(api.GET("/v1/scenes/{scene_id}/jobs", { params: { path } }));
    this.jobs.value = jobs.items;
    await this.reload();
  }

  /** Follow the scene's events until the page leaves it, also after the service was away. */
  private async follow(): Promise<void> {
    let position: string | null = null;
    while (!this.aborter.signal.aborted) {
      try {
        for await (const message of sceneEvents(this.id, position, this.aborter.signal)) {
          if (this.connection.value !== "live") {
            if (position === null) await this.load();
            this.failure.value = null;
            this.connection.value = "live";
          }
          position = message.id ?? position;
          if (message.event) this.apply(message.event);
          if (message.event?.kind === "scene.deleted") return;
        }
      } catch (error) {
        if (this.aborter.signal.aborted) return;
        if (error instanceof ServiceError && error.status !== 0 && error.status < 500) {
          this.failure.value = error;
          this.connection.value = "ended";
          return;
        }
      }
      this.connection.value = "reconnecting";
      await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
    }
  }

  private apply(event: SceneEvent): void {
    const [noun] = event.kind.split(".");
    if (event.kind === "scene.deleted") {
      this.failure.value = new ServiceError(strings.sceneGone, "", "not-found", 404);
      this.connection.value = "ended";
      return;
    }
    if (event.kind === "events.deleted") {
      void this.load().catch(report);
      return;
    }
    if (noun === "job") {
      this.applyToJob(event);
      if (event.kind !== "job.progress") this.stale.add("images");
    } else if (noun === "image") {
      this.imageEvents?.push(event);
      this.images.value = afterEvents(this.images.value, [event]);
    } else if (noun === "snapshot") this.stale.add("snapshots").add("images");
    else if (noun === "ranking") this.stale.add("rankings");
    else if (noun === "plan") this.stale.add("plans");
    else if (noun === "visits") this.stale.add("visits");
    this.stale.add("scene");
    this.refresh();
  }

  /** Show progress at once; what else changed of a job is loaded. */
  private applyToJob(event: SceneEvent): void {
    const id = event.data["job_id"] as string;
    const known = this.jobs.value.find((job) => job.id === id);
    if (event.kind === "job.progress" && known) {
      const { stage, progress, eta_s } = event.data as Pick<Schemas["Job"], "stage" | "progress" | "eta_s">;
      const state = "running" as const;
      this.replaceJob({ ...known, state, stage, progress, eta_s: eta_s ?? null });
    } else this.staleJobs.add(id);
  }

  private replaceJob(job: Schemas["Job"]): void {
    const known = this.jobs.value.some((one) => one.id === job.id);
    this.jobs.value = known
      ? this.jobs.value.map((one) => (one.id === job.id ? job : one))
      : [job, ...this.jobs.value];
  }

  /** Load what events made stale, after what is being loaded: an older answer never follows a newer one. */
  private reload(): Promise<void> {
    this.loading = this.loading.catch(() => undefined).then(() => this.loadStale());
    return this.loading;
  }

  /** What fails stays stale. Throws the first failure. */
  private async loadStale(): Promise<void> {
    const stale = new Set(this.stale);
    const jobs = [...this.staleJobs];
    this.stale.clear();
    this.staleJobs.clear();
    const path = { scene_id: this.id };
    const query = (after: string | undefined) => ({ limit: PAGE, ...(after === undefined ? {} : { after }) });
    const load = {
      scene: async () => {
        this.scene.value = await data(api.GET("/v1/scenes/{scene_id}", { params: { path } }));
      },
      images: async () => {
        const meanwhile: SceneEvent[] = [];
        this.imageEvents = meanwhile;
        try {
          const images = await all((after) =>
            data(api.GET("/v1/scenes/{scene_id}/images", { params: { path, query: query(after) } })),
          );
          this.images.value = afterEvents(images, meanwhile);
        } finally {
          this.imageEvents = null;
        }
      },
      snapshots: async () => {
        this.snapshots.value = await all((after) =>
          data(api.GET("/v1/scenes/{scene_id}/snapshots", { params: { path, query: query(after) } })),
        );
      },
      rankings: async () => {
        this.rankings.value = (
          await data(api.GET("/v1/scenes/{scene_id}/rankings", { params: { path } }))
        ).items;
      },
      plans: async () => {
        this.plans.value = (await data(api.GET("/v1/scenes/{scene_id}/plans", { params: { path } }))).items;
      },
      visits: async () => {
        this.visits.value = (
          await data(api.GET("/v1/scenes/{scene_id}/visits", { params: { path } }))
        ).visits;
      },
    };
    const lists = [...stale].map(async (name) => {
      await load[name]().catch((error: unknown) => {
        this.stale.add(name);
        throw error;
      });
    });
    const ofJobs = jobs.map(async (job_id) =>
      this.replaceJob(await data(api.GET("/v1/jobs/{job_id}", { params: { path: { job_id } } }))),
    );
    const results = await Promise.allSettled([...lists, ...ofJobs]);
    const failed = results.find((one) => one.status === "rejected");
    if (failed) throw failed.reason;
  }

  private async showCameras(snapshotId: string | null): Promise<void> {
    try {
      const cameras = snapshotId === null ? null : await loadCameras(snapshotId);
      if ((this.snapshot.value?.id ?? null) === snapshotId) this.cameras.value = cameras;
    } catch (error) {
      report(error);
    }
  }
}

/** What every part of a scene's page gets. */
export interface SceneProps {
  store: SceneStore;
}
