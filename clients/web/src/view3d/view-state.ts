import { computed, signal } from "@preact/signals";
import type { Quaternion, SnapshotCameras, Triple } from "../api/artifacts";
import type { Frames } from "../geometry/frames";
import { conjugate, multiply } from "../geometry/vectors";
import { stored } from "../store/stored";
import { LAYERS, type Layer, type Marker } from "./content";
import { detectGl } from "./gl-support";
import type { Viewpoint } from "./viewpoint";

/** Who draws the splat: this computer, the service, or whichever is faster. */
export const SOURCES = ["auto", "local", "service"] as const;
export type Source = (typeof SOURCES)[number];

/** What is loading, what was drawn how, or what failed. */
export type ModelState =
  | { kind: "none" | "loading" | "local" }
  | { kind: "service"; latencyMs: number | null }
  | { kind: "failed"; message: string };

/** Above this time of a frame the service's renders, which take about as long, replace the local splat. */
const SLOW_FRAME_MS = 150;

const SOURCE = "fvs-splat-source";
const HIDDEN = "fvs-hidden-layers";

/** The viewpoint when the 3D view of a scene was left. */
export interface LastView {
  view: Viewpoint;
  cameras: SnapshotCameras | null;
}

/** What is chosen in the 3D view of any scene; it stays while the stage changes. */
export class ViewState {
  readonly gl = detectGl();
  /** By scene. */
  readonly last = new Map<string, LastView>();
  readonly source = signal<Source>((localStorage.getItem(SOURCE) as Source | null) ?? "auto");
  /** How long a frame with the splat took here; null before it was measured. */
  readonly frameMs = signal<number | null>(null);
  readonly model = signal<ModelState>({ kind: "none" });
  readonly contextLost = signal(false);
  readonly hovered = signal<{ marker: Marker; at: readonly [number, number] } | null>(null);
  readonly hidden = signal<ReadonlySet<Layer>>(
    new Set(stored<Layer[]>(localStorage, HIDDEN, ["points", "grid"])),
  );
  readonly shown = computed(() => new Set(LAYERS.filter((layer) => !this.hidden.value.has(layer))));

  /** Whether the splat is drawn here. */
  readonly local = computed(() => {
    if (this.gl === "none" || this.source.value === "service") return false;
    if (this.source.value === "local") return true;
    return this.gl === "hardware" && (this.frameMs.value ?? 0) < SLOW_FRAME_MS;
  });

  choose(source: Source): void {
    localStorage.setItem(SOURCE, source);
    this.frameMs.value = null;
    this.source.value = source;
  }

  toggle(layer: Layer): void {
    const hidden = new Set(this.hidden.value);
    if (!hidden.delete(layer)) hidden.add(layer);
    localStorage.setItem(HIDDEN, JSON.stringify([...hidden]));
    this.hidden.value = hidden;
  }
}

let state: ViewState | null = null;

/** The state of this page. */
export function viewState(): ViewState {
  state ??= new ViewState();
  return state;
}

/** A viewpoint with a name, in the world frame, which outlives models. */
export interface SavedViewpoint {
  name: string;
  position: Triple;
  orientation: Quaternion;
  distance: number;
}

const viewpointsOf = (sceneId: string) => `fvs-viewpoints-${sceneId}`;

export function savedViewpoints(sceneId: string): readonly SavedViewpoint[] {
  return stored<SavedViewpoint[]>(localStorage, viewpointsOf(sceneId), []);
}

export function saveViewpoints(sceneId: string, viewpoints: readonly SavedViewpoint[]): void {
  localStorage.setItem(viewpointsOf(sceneId), JSON.stringify(viewpoints));
}

/** A viewpoint of the model in the world. */
export function inWorld(name: string, view: Viewpoint, frames: Frames): SavedViewpoint {
  const { rotation_wxyz, scale } = frames.alignment;
  return {
    name,
    position: frames.worldFromModel(view.position),
    orientation: multiply(rotation_wxyz, view.orientation),
    distance: view.distance * scale,
  };
}

/** The same viewpoint in a model. */
export function inModel(saved: SavedViewpoint, frames: Frames): Viewpoint {
  const { rotation_wxyz, scale } = frames.alignment;
  return {
    position: frames.modelFromWorld(saved.position),
    orientation: multiply(conjugate(rotation_wxyz), saved.orientation),
    distance: saved.distance / scale,
  };
}
