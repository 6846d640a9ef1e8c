import { send } from "../api/service";
import type { Camera } from "../geometry/frames";

const DRAG_LONG_SIDE_PX = 320;

/**
 * Renders of a snapshot by the service, for computers that cannot draw splats.
 *
 * One request is under way at a time, and only the newest pose waits for it. While the view moves they are small; a large
 * one is given up as soon as the view moves again.
 */
export class ServiceRenders {
  private wanted: { camera: Camera; longSide: number | null } | null = null;
  private running: { aborter: AbortController; large: boolean } | null = null;
  /** How long the last small render took, from the request to the image. */
  latencyMs: number | null = null;

  constructor(
    private readonly snapshotId: string,
    private readonly onRender: (bitmap: ImageBitmap) => void,
    private readonly onFailure: (error: unknown) => void,
  ) {}

  /** Render a camera; `moving` asks for a small image soon, else it is as large as `longSide` px. */
  request(camera: Camera, moving: boolean, longSide: number): void {
    this.wanted = { camera, longSide: moving ? DRAG_LONG_SIDE_PX : longSide };
    if (this.running?.large && moving) this.running.aborter.abort();
    if (!this.running) void this.run();
  }

  /** Give up what is under way. */
  stop(): void {
    this.wanted = null;
    this.running?.aborter.abort();
  }

  private async run(): Promise<void> {
    while (this.wanted) {
      const { camera, longSide } = this.wanted;
      this.wanted = null;
      const aborter = new AbortController();
      const small = longSide === DRAG_LONG_SIDE_PX;
      this.running = { aborter, large: !small };
      const began = performance.now();
      try {
        const bitmap = await renderOf(this.snapshotId, camera, longSide, aborter.signal);
        if (small) this.latencyMs = performance.now() - began;
        this.onRender(bitmap);
      } catch (error) {
        if (!aborter.signal.aborted) {
          this.wanted = null;
          this.onFailure(error);
        }
      }
    }
    this.running = null;
  }
}

/** A render of a snapshot at a camera of its model frame. Throws `ServiceError`. */
export async function renderOf(
  snapshotId: string,
  camera: Camera,
  longSide: number | null,
  signal: AbortSignal,
): Promise<ImageBitmap> {
  const pose = { frame: "model", position: camera.position, orientation_wxyz: camera.orientation };
  const answer = await send(`/v1/snapshots/${snapshotId}/renders`, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ pose, long_side_px: longSide, format: "jpeg" }),
    signal,
  });
  return createImageBitmap(await answer.blob());
}
