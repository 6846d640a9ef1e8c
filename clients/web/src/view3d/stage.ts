import type { Triple } from "../api/artifacts";
import { dot, length, minus } from "../geometry/vectors";
import type { Content, Layer, Marker } from "./content";
import type { Sample } from "./forecast";
import type { GlSupport } from "./gl-support";
import { fitted, type Lens } from "./lens";
import { edgesOf, frustumSize, groundHeight, groundOf } from "./lines";
import { drawOverlay } from "./overlay";
import { type Palette, paletteOf } from "./palette";
import type { Points } from "./ply";
import type { Viewpoint } from "./viewpoint";
import type { Strokes, WebglLayers } from "./webgl";

const LINE_PX = 2;
const HIGHLIGHT_PX = 4;
const SMALLEST_RENDER_PX = 64;
/** The layers that are lines between markers. */
const LINED = ["images", "unregistered", "candidates", "visits", "route"] as const;
/** How far the centre may move, in radii, before positions are taken relative to another place. */
const FAR = 3;

/**
 * The canvases of the view, one above the other: the service's render, WebGL, and an overlay.
 *
 * Without WebGL, or with WebGL in software, the overlay draws lines and points, too.
 */
export class Stage {
  width = 1;
  height = 1;
  lens: Lens;
  /** The depth of frusta. */
  frustum = 0.1;
  /** How far the lines of the grid are apart, in units of the model. */
  gridSpacing = 1;
  layers: WebglLayers | null = null;
  /** Whether there is a render of the service. */
  hasRender = false;
  private palette: Palette;
  private strokes: { layer: Layer; strokes: Strokes[] }[] = [];
  private points: Points | null = null;
  private samples: readonly Sample[] = [];
  private highlighted: readonly Marker[] = [];
  private origin: Triple | null = null;
  private readonly image = canvas();
  private readonly overlay = canvas();

  constructor(
    private readonly host: HTMLElement,
    private readonly gl: GlSupport,
    public content: Content,
    private readonly onContext: (lost: boolean) => void,
  ) {
    this.palette = paletteOf(host);
    this.lens = fitted(content.intrinsics, 1, 1);
    host.append(this.image, this.overlay);
    this.resize();
  }

  /** Draw lines and points with WebGL, where there is a context, or on the overlay. */
  async useWebgl(wanted: boolean): Promise<void> {
    if (!wanted) this.dropLayers();
    if (!wanted || this.layers) return;
    const { WebglLayers } = await import("./webgl");
    if (!this.host.contains(this.overlay) || this.layers) return;
    const element = canvas();
    try {
      this.layers = new WebglLayers(element);
    } catch {
      return; // the overlay draws everything
    }
    this.image.after(element);
    element.addEventListener("webglcontextlost", () => {
      if (this.layers?.renderer.domElement !== element) return;
      this.dropLayers();
      this.onContext(true);
    });
    element.addEventListener("webglcontextrestored", () => this.onContext(false));
    this.layers.centre(this.origin ?? [0, 0, 0], this.content.radius);
    this.resize();
    this.redraw();
  }

  dispose(): void {
    this.dropLayers();
    this.host.replaceChildren();
  }

  private dropLayers(): void {
    const { layers } = this;
    this.layers = null;
    layers?.renderer.domElement.remove();
    void layers?.dispose();
  }

  resize(): void {
    this.width = Math.max(1, this.host.clientWidth);
    this.height = Math.max(1, this.host.clientHeight);
    this.overlay.width = this.width * devicePixelRatio;
    this.overlay.height = this.height * devicePixelRatio;
    this.layers?.resize(this.width, this.height, this.gl === "software" ? 1 : Math.min(devicePixelRatio, 2));
    this.lens = fitted(this.content.intrinsics, this.width, this.height);
  }

  setContent(content: Content): void {
    this.content = content;
    if (this.origin === null || length(minus(content.centre, this.origin)) > FAR * content.radius) {
      this.origin = content.centre;
      this.layers?.centre(this.origin, content.radius);
    }
    this.lens = fitted(content.intrinsics, this.width, this.height);
    this.frustum = frustumSize(content);
    this.drawMarkers();
  }

  setPoints(points: Points | null): void {
    this.points = points;
    this.layers?.setPoints(points);
    this.drawGrid();
  }

  setSamples(samples: readonly Sample[]): void {
    this.samples = samples;
    this.layers?.setSamples(samples, this.palette.ofValue, this.content.radius / 60);
  }

  setHighlighted(markers: readonly Marker[]): void {
    this.highlighted = markers;
    const segments = markers.flatMap((marker) => this.edges(marker, 1.15));
    this.layers?.setLines("highlight", [{ colour: this.palette.accent, segments }], HIGHLIGHT_PX);
  }

  /** Draw everything again, in the colours of the theme. */
  redraw(): void {
    this.palette = paletteOf(this.host);
    this.drawMarkers();
    this.setPoints(this.points);
    this.setSamples(this.samples);
    this.setHighlighted(this.highlighted);
  }

  /** The long side of a render that shows all that the canvas can show, in px. */
  get renderSize(): number {
    const { frame } = this.lens;
    const { width_px, height_px } = this.content.intrinsics;
    const seen = Math.max(frame.width, frame.height) * devicePixelRatio;
    return Math.min(Math.max(seen, SMALLEST_RENDER_PX), Math.max(width_px, height_px));
  }

  showRender(bitmap: ImageBitmap): void {
    const { left, top, width, height } = this.lens.frame;
    this.image.width = this.width * devicePixelRatio;
    this.image.height = this.height * devicePixelRatio;
    const context = this.image.getContext("2d");
    context?.scale(devicePixelRatio, devicePixelRatio);
    context?.drawImage(bitmap, left, top, width, height);
    bitmap.close();
    this.hasRender = true;
  }

  forgetRender(): void {
    this.image.getContext("2d")?.clearRect(0, 0, this.image.width, this.image.height);
    this.hasRender = false;
  }

  /** The layers to draw of those that are wanted: points stand in for a model that is not there yet. */
  shown(wanted: ReadonlySet<Layer>): ReadonlySet<Layer> {
    const drawn = this.hasRender || this.layers?.get("splat") !== undefined;
    return wanted.has("splat") && !drawn ? new Set([...wanted, "points"]) : wanted;
  }

  /** Draw a frame; `framed` shows where a camera's image ends. */
  draw(view: Viewpoint, wanted: ReadonlySet<Layer>, framed: boolean): void {
    const { layers, lens, width, height, content, palette } = this;
    const shown = this.shown(wanted);
    this.image.style.visibility = shown.has("splat") ? "visible" : "hidden";
    if (layers) {
      layers.show(shown);
      layers.render(view, lens, width, height);
    }
    // Without a graphics card the processor draws lines best, not the software that stands in for the card.
    const context = this.overlay.getContext("2d", { willReadFrequently: this.gl !== "hardware" });
    if (!context) return;
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    const highlighted = this.highlighted.flatMap((marker) => this.edges(marker, 1.15));
    const flat = layers
      ? null
      : { strokes: this.strokes, points: this.points, samples: this.samples, highlighted };
    drawOverlay(context, { content, view, lens, width, height, palette, shown, flat, framed });
  }

  private edges(marker: Marker, scale = 1) {
    return edgesOf(marker, this.content.intrinsics, this.frustum * scale);
  }

  private drawMarkers(): void {
    const { content, palette } = this;
    this.strokes = LINED.map((layer) => ({ layer, strokes: this.strokesOf(layer) }));
    const route = this.strokes.find((one) => one.layer === "route");
    for (const { vehicle, way } of content.routes) {
      const segments = way.slice(1).map((to, index) => [way[index] as Triple, to] as const);
      route?.strokes.push({ colour: palette.of({ kind: "vehicle", number: vehicle }), segments });
    }
    for (const { layer, strokes } of this.strokes) this.layers?.setLines(layer, strokes, LINE_PX);
    this.drawGrid();
  }

  private strokesOf(layer: Layer): Strokes[] {
    const byColour = new Map<string, (readonly [Triple, Triple])[]>();
    for (const marker of this.content.markers) {
      if (marker.layer !== layer) continue;
      const colour = this.palette.of(marker.paint);
      const segments = byColour.get(colour) ?? [];
      byColour.set(colour, segments);
      segments.push(...this.edges(marker));
    }
    return [...byColour].map(([colour, segments]) => ({ colour, segments }));
  }

  private drawGrid(): void {
    const { content, points } = this;
    const height = (points && groundHeight(points.positions, content.up)) ?? lowest(content);
    const { spacing, lines } = groundOf(content, height);
    this.gridSpacing = spacing;
    const strokes = [{ colour: this.palette.line, segments: lines }];
    this.strokes = [...this.strokes.filter((one) => one.layer !== "grid"), { layer: "grid", strokes }];
    this.layers?.setLines("grid", strokes, 1);
  }
}

function canvas(): HTMLCanvasElement {
  const element = document.createElement("canvas");
  element.className = "layer";
  return element;
}

/** The height along `up` of what is lowest; the centre's where nothing is. */
function lowest({ markers, up, centre }: Content): number {
  return markers.reduce((least, one) => Math.min(least, dot(one.position, up)), dot(centre, up));
}
