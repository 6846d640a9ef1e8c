import { artifactPath } from "../api/paths";
import { wordsOf } from "../api/problem";
import { bytes } from "../api/service";
import type { Camera } from "../geometry/frames";
import { strings } from "../strings";
import { type Points, parsePoints } from "./ply";
import { ServiceRenders } from "./service-renders";
import type { ViewState } from "./view-state";
import type { WebglLayers } from "./webgl";

/** The sentence about what went wrong. */
export function sentence(error: unknown): string {
  const { message, hint } = wordsOf(error);
  return `${message} ${hint}`.trim();
}

/** What the model of a snapshot looks like: its points, and its splat or the service's renders. */
export class ModelSource {
  points: Points | null = null;
  private renders: ServiceRenders | null = null;
  private aborter = new AbortController();

  constructor(
    private readonly state: ViewState,
    private readonly onChange: () => void,
    private readonly onRender: (bitmap: ImageBitmap) => void,
  ) {}

  /** Load the points of a snapshot; those of the one before stay until they are there. */
  async loadPoints(snapshotId: string, signal: AbortSignal): Promise<void> {
    const file = await bytes(artifactPath(snapshotId, "points.ply"), signal);
    const points = parsePoints(await file.arrayBuffer());
    signal.throwIfAborted();
    this.points = points;
    this.onChange();
  }

  /** Load the splat of a snapshot; the one before stays until it is there. Returns whether it is seen. */
  async loadSplat(snapshotId: string, layers: WebglLayers, onDirty: () => void): Promise<boolean> {
    const { signal } = this.restart();
    if (this.state.model.value.kind !== "local") this.state.model.value = { kind: "loading" };
    try {
      const { loadSplat } = await import("./splat");
      const splat = await loadSplat(snapshotId, layers, onDirty, signal);
      layers.setPlaced("splat", splat);
      this.state.model.value = { kind: "local" };
      this.onChange();
      await splat.sorted;
      return !signal.aborted;
    } catch (error) {
      if (!signal.aborted)
        this.state.model.value = { kind: "failed", message: strings.view3d.splatFailed(sentence(error)) };
      return false;
    }
  }

  /** Let the service render a snapshot. */
  useService(snapshotId: string): void {
    this.restart();
    this.state.model.value = { kind: "service", latencyMs: null };
    const renders = new ServiceRenders(
      snapshotId,
      (bitmap) => {
        if (this.renders === renders) {
          this.state.model.value = { kind: "service", latencyMs: renders.latencyMs };
          this.onRender(bitmap);
        } else bitmap.close();
      },
      (error) => {
        if (this.renders === renders)
          this.state.model.value = { kind: "failed", message: strings.view3d.rendersFailed(sentence(error)) };
      },
    );
    this.renders = renders;
  }

  /** Let the service, if it renders, render another camera. */
  request(camera: Camera, moving: boolean, longSide: number): void {
    this.renders?.request(camera, moving, Math.round(longSide));
  }

  /** Give up what is under way, and forget the service's renders. */
  restart(): AbortController {
    this.aborter.abort();
    this.renders?.stop();
    this.renders = null;
    this.aborter = new AbortController();
    return this.aborter;
  }
}
