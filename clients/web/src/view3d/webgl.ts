import {
  BufferAttribute,
  BufferGeometry,
  Color,
  type Object3D,
  PerspectiveCamera,
  Points as PointCloud,
  PointsMaterial,
  Scene,
  WebGLRenderer,
} from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import type { Quaternion, Triple } from "../api/artifacts";
import { minus, multiply } from "../geometry/vectors";
import type { Layer } from "./content";
import type { Sample } from "./forecast";
import { type Lens, projectionMatrix } from "./lens";
import type { Segment } from "./lines";
import { partsOf } from "./palette";
import type { Points } from "./ply";
import type { Viewpoint } from "./viewpoint";

/** An object that frees what it has on the graphics card. */
export type Owned = Object3D & { release: () => void | Promise<void> };

/** Lines of one colour. */
export interface Strokes {
  colour: string;
  segments: readonly Segment[];
}

const HALF_TURN_ABOUT_X: Quaternion = [0, 1, 0, 0];

/**
 * The layers of the view in WebGL.
 *
 * Positions are drawn relative to `origin`, so that single precision suffices far from zero.
 */
export class WebglLayers {
  readonly renderer: WebGLRenderer;
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera();
  private readonly layers = new Map<Layer | "highlight", Owned>();
  private readonly released: Promise<void>[] = [];
  private origin: Triple = [0, 0, 0];
  private radius = 1;

  /** Throws when the canvas gives no context. */
  constructor(canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({
      canvas,
      alpha: true,
      antialias: false,
      powerPreference: "high-performance",
    });
    this.renderer.setClearColor(0, 0);
    this.camera.matrixAutoUpdate = false;
  }

  /** Draw relative to another place. */
  centre(origin: Triple, radius: number): void {
    const shift = minus(this.origin, origin);
    for (const object of this.layers.values()) object.position.add({ x: shift[0], y: shift[1], z: shift[2] });
    this.origin = origin;
    this.radius = radius;
  }

  setPoints(points: Points | null): void {
    if (!points) {
      this.set("points", null);
      return;
    }
    const geometry = new BufferGeometry();
    const positions = new Float32Array(points.positions.length);
    for (let at = 0; at < positions.length; at++)
      positions[at] = (points.positions[at] as number) - (this.origin[at % 3] as number);
    geometry.setAttribute("position", new BufferAttribute(positions, 3));
    geometry.setAttribute("color", new BufferAttribute(linear(points.colours), 3));
    this.set("points", cloud(geometry, 2, false));
  }

  /** Places of the surface, each a dot of a colour with a diameter in units of the model. */
  setSamples(samples: readonly Sample[], colours: (value: number) => string, diameter: number): void {
    if (samples.length === 0) {
      this.set("forecast", null);
      return;
    }
    const geometry = new BufferGeometry();
    const positions = samples.flatMap((sample) => minus(sample.position, this.origin));
    const parts = samples.flatMap((sample) =>
      new Color().setRGB(...partsOf(colours(sample.value)), "srgb").toArray(),
    );
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
    geometry.setAttribute("color", new BufferAttribute(new Float32Array(parts), 3));
    this.set("forecast", cloud(geometry, diameter, true));
  }

  setLines(layer: Layer | "highlight", strokes: readonly Strokes[], width: number): void {
    const count = strokes.reduce((sum, one) => sum + one.segments.length, 0);
    if (count === 0) {
      this.set(layer, null);
      return;
    }
    const positions = new Float32Array(count * 6);
    const colours = new Float32Array(count * 6);
    let at = 0;
    for (const { colour, segments } of strokes) {
      const parts = new Color().setRGB(...partsOf(colour), "srgb").toArray();
      for (const [from, to] of segments) {
        positions.set(minus(from, this.origin), at);
        positions.set(minus(to, this.origin), at + 3);
        colours.set(parts, at);
        colours.set(parts, at + 3);
        at += 6;
      }
    }
    const geometry = new LineSegmentsGeometry();
    geometry.setPositions(positions);
    geometry.setColors(colours);
    const material = new LineMaterial({
      linewidth: width,
      vertexColors: true,
      depthTest: layer !== "highlight",
    });
    const lines = new LineSegments2(geometry, material);
    lines.frustumCulled = false;
    if (layer === "highlight") lines.renderOrder = 2;
    this.set(layer, owned(lines, geometry, material));
  }

  /** Put an object that is in the model frame in a layer. */
  setPlaced(layer: Layer, object: Owned): void {
    object.position.set(-this.origin[0], -this.origin[1], -this.origin[2]);
    this.set(layer, object);
  }

  /** Put an object in a layer, in place of the one before; null leaves none. */
  set(layer: Layer | "highlight", object: Owned | null): void {
    const before = this.layers.get(layer);
    if (before) {
      this.scene.remove(before);
      const released = before.release();
      if (released) this.released.push(released);
      this.layers.delete(layer);
    }
    if (object) {
      this.scene.add(object);
      this.layers.set(layer, object);
    }
  }

  get(layer: Layer): Object3D | undefined {
    return this.layers.get(layer);
  }

  show(shown: ReadonlySet<Layer>): void {
    for (const [layer, object] of this.layers) object.visible = layer === "highlight" || shown.has(layer);
  }

  resize(width: number, height: number, ratio: number): void {
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
  }

  /** Draw the view of a lens on the whole canvas, whose size is in CSS px. */
  render(view: Viewpoint, lens: Lens, width: number, height: number): void {
    const [w, x, y, z] = multiply(view.orientation, HALF_TURN_ABOUT_X);
    const { camera } = this;
    camera.position.set(...minus(view.position, this.origin));
    camera.quaternion.set(x, y, z, w);
    camera.updateMatrix();
    camera.updateMatrixWorld(true);
    const near = Math.max(this.radius * 1e-3, Math.min(view.distance, this.radius) * 0.01);
    const far = this.radius * 100 + view.distance * 2;
    const rows = projectionMatrix(lens, width, height, near, far);
    camera.near = near;
    camera.far = far;
    camera.fov = (2 * Math.atan(height / (2 * lens.fy)) * 180) / Math.PI;
    camera.projectionMatrix.set(...(rows as Parameters<typeof camera.projectionMatrix.set>));
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    this.renderer.render(this.scene, camera);
  }

  /** Wait until everything is drawn. */
  finish(): void {
    const gl = this.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  /** Free the context with all that it has. */
  async dispose(): Promise<void> {
    for (const layer of [...this.layers.keys()]) this.set(layer, null);
    await Promise.all(this.released);
    const lost = this.renderer.getContext().isContextLost();
    this.renderer.dispose();
    if (!lost) this.renderer.forceContextLoss();
  }
}

function cloud(geometry: BufferGeometry, size: number, sizeAttenuation: boolean) {
  const material = new PointsMaterial({ size, sizeAttenuation, vertexColors: true });
  const points = new PointCloud(geometry, material);
  points.frustumCulled = false;
  return owned(points, geometry, material);
}

/** Linear parts from 0 to 1, as three.js has colours, of sRGB bytes. */
function linear(bytes: Uint8Array): Float32Array {
  const table = Float32Array.from(
    { length: 256 },
    (_, byte) => new Color().setRGB(byte / 255, 0, 0, "srgb").r,
  );
  return Float32Array.from(bytes, (byte) => table[byte] as number);
}

function owned<T extends Object3D>(
  object: T,
  ...parts: { dispose: () => void }[]
): T & { release: () => void } {
  return Object.assign(object, {
    release: () => {
      for (const part of parts) part.dispose();
    },
  });
}
