import { Object3D } from "three";
import { artifactPath } from "../api/paths";
import { bytes } from "../api/service";
import type { Owned, WebglLayers } from "./webgl";

const WAIT_MS = 50;
const MOST_WAITS = 200;

/** Gaussians; `sorted` comes when they are in order for the first time, and so seen. */
export type Splat = Owned & { sorted: Promise<void> };

/** Load the Gaussians of a snapshot, in its model frame; `onDirty` is called when they have to be drawn again. */
export async function loadSplat(
  snapshotId: string,
  layers: WebglLayers,
  onDirty: () => void,
  signal: AbortSignal,
): Promise<Splat> {
  const [spark, file] = await Promise.all([
    import("@sparkjsdev/spark"),
    bytes(artifactPath(snapshotId, "point_cloud.spz"), signal),
  ]);
  // Extended splats have centres in single precision; packed ones would move by 1/2000 of their coordinates.
  const mesh = new spark.SplatMesh({
    fileBytes: await file.arrayBuffer(),
    fileType: spark.SplatFileType.SPZ,
    extSplats: true,
    raycastable: false,
    editable: false,
  });
  await mesh.initialized;
  signal.throwIfAborted();
  // The axes of an SPZ file are right, up, back; those of the model right, down, forward.
  mesh.quaternion.set(1, 0, 0, 0);
  let resolve = () => {};
  const sorted = new Promise<void>((done) => {
    resolve = done;
  });
  const renderer = new spark.SparkRenderer({
    renderer: layers.renderer,
    onDirty: () => {
      if (renderer.activeSplats > 0) resolve();
      onDirty();
    },
    enableLod: false,
    accumExtSplats: true,
    sortRadial: false,
    // As the engine draws: 0.3 px² are added to every covariance, the opacity stays, and splats end at 3.33 σ or 1/255.
    preBlurAmount: 0.3,
    blurAmount: 0,
    maxStdDev: 3.33,
    minAlpha: 1 / 255,
    maxPixelRadius: 4096,
  });
  const group = new Object3D();
  group.add(renderer, mesh);
  return Object.assign(group, {
    sorted,
    release: async () => {
      // What is being sorted cannot be interrupted.
      renderer.sortDirty = false;
      for (let wait = 0; renderer.sorting && wait < MOST_WAITS; wait++)
        await new Promise((done) => setTimeout(done, WAIT_MS));
      mesh.dispose();
      renderer.dispose();
      renderer.geometry.dispose();
      renderer.material.dispose();
    },
  });
}
