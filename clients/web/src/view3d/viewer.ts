import { computed, effect, untracked } from "@preact/signals";
import type { SnapshotCameras, Triple } from "../api/artifacts";
import { add, cross, dot, length, minus, rotate, times } from "../geometry/vectors";
import type { SceneStore } from "../store/scene";
import { theme } from "../theme";
import { carried } from "./carry";
import { type Content, contentOf, type Layer, type Marker } from "./content";
import { fitted, type Lens, project } from "./lens";
import { edgesOf, frustumSize, groundHeight, groundOf } from "./lines";
import { ModelSource } from "./model-source";
import { type Navigated, Navigation } from "./navigation";
import { drawOverlay } from "./overlay";
import { type Palette, paletteOf } from "./palette";
import { pick, pickable } from "./picking";
import type { ServiceRender } from "./service-renders";
import type { ViewState } from "./view-state";
import { across, between, framing, fromAbove, lookAt, move, orbit, turn, type Viewpoint } from "./viewpoint";
import type { Strokes, WebglLayers } from "./webgl";

const TRAVEL_MS = 450;
const REST_MS = 180;
const LINE_PX = 2;
const HIGHLIGHT_PX = 4;
const MEASURED_FRAMES = 4;
/** The layers that are lines. */
const LINED = ["images", "unregistered", "candidates", "visits", "route"] as const;

/** The canvases of the stage and what happens on them. It draws only when something has changed. */
export class Viewer implements Navigated {
  view: Viewpoint = lookAt([0, -3, 1], [0, 0, 0], [0, 0, 1]);
  up: Triple = [0, 0, 1];
  radius = 1;
  lens: Lens;
  /** How far the lines of the grid are apart, in units of the model. */
  gridSpacing = 1;
  private content: Content;
  private frustum = 0.1;
  private strokes: { layer: Layer; strokes: Strokes[] }[] = [];
  private palette: Palette;
  private layers: WebglLayers | null = null;
  private origin: Triple = [0, 0, 0];
  private cameras: SnapshotCameras | null = null;
  private placed = false;
  private back: Viewpoint | null = null;
  private travel: { from: Viewpoint; to: Viewpoint; began: number } | null = null;
  private width = 1;
  private height = 1;
  private waiting = 0;
  private resting: ReturnType<typeof setTimeout> | undefined;
  private hasRender = false;
  private disposed = false;
  private readonly source: ModelSource;
  private readonly snapshotId = computed(() => this.store.snapshot.value?.id);
  private readonly navigation: Navigation;
  private readonly image = canvas();
  private readonly overlay = canvas();
  private readonly observer: ResizeObserver;
  private readonly ends: (() => void)[] = [];

  constructor(
    private readonly host: HTMLElement,
    private readonly store: SceneStore,
    private readonly state: ViewState,
  ) {
    this.palette = paletteOf(host);
    this.content = untracked(() => contentOf(store));
    this.lens = fitted(this.content.intrinsics, 1, 1);
    this.source = new ModelSource(
      state,
      () => this.showPoints(),
      (render) => this.showRender(render),
    );
    host.append(this.image, this.overlay);
    this.navigation = new Navigation(host, this);
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(host);
    void this.begin();
  }

  dispose(): void {
    this.disposed = true;
    for (const end of this.ends) end();
    cancelAnimationFrame(this.waiting);
    clearTimeout(this.resting);
    this.observer.disconnect();
    this.navigation.dispose();
    this.source.restart();
    this.dropLayers();
    this.host.replaceChildren();
    this.state.model.value = { kind: "none" };
    this.state.hovered.value = null;
  }

  private async begin(): Promise<void> {
    if (this.state.gl !== "none") await this.makeLayers();
    if (this.disposed) return;
    const { store, state } = this;
    this.ends.push(
      effect(() => this.showContent()),
      effect(() => this.loadPoints()),
      effect(() => this.showModel()),
      effect(() => {
        theme.value;
        this.palette = paletteOf(this.host);
        untracked(() => this.drawLines());
      }),
      effect(() => {
        state.shown.value;
        state.model.value;
        this.invalidate();
      }),
      effect(() => {
        const camera = store.lookThrough.value;
        untracked(() => this.look(camera));
      }),
      effect(() => {
        store.selection.value;
        state.hovered.value;
        untracked(() => this.highlight());
      }),
    );
  }

  // The canvases.

  private async makeLayers(): Promise<void> {
    const { WebglLayers } = await import("./webgl");
    if (this.disposed) return;
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
      this.state.contextLost.value = true;
      this.invalidate();
    });
    element.addEventListener("webglcontextrestored", () => {
      if (!this.disposed) void this.restore();
    });
    this.layers.centre(this.origin, this.radius);
    this.resize();
  }

  private async restore(): Promise<void> {
    await this.makeLayers();
    this.state.contextLost.value = false;
    this.drawLines();
    this.showPoints();
  }

  private dropLayers(): void {
    const { layers } = this;
    this.layers = null;
    layers?.dispose();
    layers?.renderer.domElement.remove();
  }

  private resize(): void {
    this.width = Math.max(1, this.host.clientWidth);
    this.height = Math.max(1, this.host.clientHeight);
    const ratio = this.state.gl === "software" ? 1 : Math.min(devicePixelRatio, 2);
    this.overlay.width = this.width * devicePixelRatio;
    this.overlay.height = this.height * devicePixelRatio;
    this.layers?.resize(this.width, this.height, ratio);
    this.lens = fitted(this.content.intrinsics, this.width, this.height);
    this.moved(false);
  }

  // What is shown.

  private showContent(): void {
    const { store } = this;
    const cameras = store.cameras.value;
    // The cameras of a snapshot come after it: until then everything stays in the frame of the one before.
    if (store.snapshot.value !== null && cameras === null) return;
    const content = contentOf(store);
    untracked(() => {
      this.content = content;
      this.up = content.up;
      this.radius = content.radius;
      if (length(minus(content.centre, this.origin)) > 3 * content.radius || !this.placed) {
        this.origin = content.centre;
        this.layers?.centre(this.origin, this.radius);
      }
      this.lens = fitted(content.intrinsics, this.width, this.height);
      this.frustum = frustumSize(content);
      this.keepViewpoint(cameras);
      this.drawLines();
    });
  }

  /** A new model is seen from where the one before was; the first one, and the first positions, as a whole. */
  private keepViewpoint(cameras: SnapshotCameras | null): void {
    const before = this.cameras;
    this.cameras = cameras;
    let kept: Viewpoint | null = null;
    if (before === cameras) kept = this.placed ? this.view : null;
    else if (before && cameras) kept = carried(this.view, before, cameras);
    if (kept) this.view = kept;
    else if (cameras || this.content.markers.length > 0) {
      this.placed = true;
      this.goTo(this.firstViewpoint(cameras), false);
    }
  }

  /** A step behind the first photograph, which looks at what was photographed; before a model from the south. */
  private firstViewpoint(cameras: SnapshotCameras | null): Viewpoint {
    const { up, north, centre, radius } = this.content;
    const first = cameras?.views[0];
    if (first) {
      const camera = { position: first.position, orientation: first.orientation_wxyz, distance: radius };
      return move(turn(camera, 0, 0, up), [0, 0, -2 * this.frustum]);
    }
    const ahead = add(north ?? across(up), times(up, -0.6));
    return framing(lookAt([0, 0, 0], ahead, up), centre, radius, this.halfAngle());
  }

  private loadPoints(): (() => void) | undefined {
    const id = this.snapshotId.value;
    if (id === undefined) return undefined;
    const aborter = new AbortController();
    this.source.loadPoints(id, aborter.signal).catch((error: unknown) => {
      if (!aborter.signal.aborted) console.warn(error); // what is wrong with a snapshot its splat says, too
    });
    return () => aborter.abort();
  }

  private showModel(): void {
    const { state, source } = this;
    const id = this.snapshotId.value;
    const local = state.local.value && !state.contextLost.value;
    untracked(() => {
      const { layers } = this;
      this.hasRender = false;
      this.image.getContext("2d")?.clearRect(0, 0, this.image.width, this.image.height);
      if (id === undefined) {
        source.restart();
        layers?.set("splat", null);
        state.model.value = { kind: "none" };
      } else if (local && layers) {
        const onDirty = () => this.invalidate();
        void source.loadSplat(id, layers, onDirty).then((drawn) => drawn && this.measure());
      } else {
        layers?.set("splat", null);
        source.useService(id);
        this.moved(false);
      }
    });
  }

  private showPoints(): void {
    this.layers?.setPoints(this.source.points);
    this.drawGrid();
    this.invalidate();
  }

  private drawLines(): void {
    const { content, palette } = this;
    this.strokes = LINED.map((layer) => ({ layer, strokes: this.strokesOf(layer) }));
    const route = this.strokes.find((one) => one.layer === "route");
    for (const { vehicle, way } of content.routes) {
      const segments = way.slice(1).map((to, index) => [way[index] as Triple, to] as const);
      route?.strokes.push({ colour: palette.of({ kind: "vehicle", number: vehicle }), segments });
    }
    for (const { layer, strokes } of this.strokes) this.layers?.setLines(layer, strokes, LINE_PX);
    this.drawGrid();
    this.highlight();
  }

  private strokesOf(layer: Layer): Strokes[] {
    const byColour = new Map<string, Strokes & { segments: (readonly [Triple, Triple])[] }>();
    for (const marker of this.content.markers) {
      if (marker.layer !== layer) continue;
      const colour = this.palette.of(marker.paint);
      const strokes = byColour.get(colour) ?? { colour, segments: [] };
      byColour.set(colour, strokes);
      strokes.segments.push(...edgesOf(marker, this.content.intrinsics, this.frustum));
    }
    return [...byColour.values()];
  }

  private drawGrid(): void {
    const { points } = this.source;
    const height = (points && groundHeight(points.positions, this.up)) ?? lowest(this.content);
    const { spacing, lines } = groundOf(this.content, height);
    this.gridSpacing = spacing;
    const strokes = [{ colour: this.palette.line, segments: lines }];
    this.strokes = [...this.strokes.filter((one) => one.layer !== "grid"), { layer: "grid", strokes }];
    this.layers?.setLines("grid", strokes, 1);
  }

  private highlight(): void {
    const strokes = this.highlighted().map(({ marker, size }) => ({
      colour: this.palette.accent,
      segments: edgesOf(marker, this.content.intrinsics, size),
    }));
    this.layers?.setLines("highlight", strokes, HIGHLIGHT_PX);
    this.invalidate();
  }

  private highlighted(): { marker: Marker; size: number }[] {
    const selected = this.selectedMarker();
    const hovered = this.state.hovered.value?.marker;
    const found: { marker: Marker; size: number }[] = [];
    if (selected) found.push({ marker: selected, size: this.frustum * 1.25 });
    if (hovered && hovered !== selected) found.push({ marker: hovered, size: this.frustum });
    return found;
  }

  private selectedMarker(): Marker | undefined {
    const wanted = JSON.stringify(this.store.selection.value);
    return this.content.markers.find((one) => one.selects && JSON.stringify(one.selects) === wanted);
  }

  // Frames.

  /** Draw a frame soon. */
  invalidate(): void {
    if (!this.waiting && !this.disposed) this.waiting = requestAnimationFrame((now) => this.frame(now));
  }

  private frame(now: number): void {
    this.waiting = 0;
    if (this.travel) this.goOn(now);
    const { state, layers, view, lens, width, height, content, palette } = this;
    const shown = this.shown();
    if (layers) {
      layers.show(shown);
      layers.render(view, lens, width, height);
    }
    const context = this.overlay.getContext("2d");
    if (!context) return;
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    const flat = layers ? null : { strokes: this.strokes, points: this.source.points };
    const framed = this.store.lookThrough.peek() !== null && this.travel === null;
    const highlighted = layers ? [] : this.highlighted();
    drawOverlay(context, { content, view, lens, width, height, palette, shown, flat, framed, highlighted });
    this.image.style.visibility = state.shown.peek().has("splat") ? "visible" : "hidden";
  }

  /** The layers to draw: points stand in for a model that is not there yet. */
  private shown(): ReadonlySet<Layer> {
    const shown = new Set(this.state.shown.peek());
    const drawn = this.hasRender || this.layers?.get("splat") !== undefined;
    if (shown.has("splat") && !drawn) shown.add("points");
    return shown;
  }

  private goOn(now: number): void {
    const { travel } = this;
    if (!travel) return;
    const share = Math.min(1, Math.max(0, now - travel.began) / TRAVEL_MS);
    this.view = between(travel.from, travel.to, share * share * (3 - 2 * share));
    if (share === 1) {
      this.view = travel.to;
      this.travel = null;
    }
    this.moved(this.travel !== null);
  }

  /** The view has moved: the service renders a small image, and the large one when it rests. */
  private moved(moving: boolean): void {
    this.invalidate();
    clearTimeout(this.resting);
    if (this.source.renders === null) return;
    const { width, height } = this.lens.frame;
    const longSide = Math.min(Math.max(width, height) * devicePixelRatio, this.longestRender());
    if (moving) {
      this.source.request(this.view, true, longSide);
      this.resting = setTimeout(() => this.moved(false), REST_MS);
    } else this.source.request(this.view, false, longSide);
  }

  private longestRender(): number {
    return Math.max(this.content.intrinsics.width_px, this.content.intrinsics.height_px);
  }

  private showRender({ bitmap }: ServiceRender): void {
    const { left, top, width, height } = this.lens.frame;
    this.image.width = this.width * devicePixelRatio;
    this.image.height = this.height * devicePixelRatio;
    const context = this.image.getContext("2d");
    context?.scale(devicePixelRatio, devicePixelRatio);
    context?.drawImage(bitmap, left, top, width, height);
    bitmap.close();
    this.hasRender = true;
    this.invalidate();
  }

  /** Measure how long a frame with the splat takes, and let the service draw where that is long. */
  private measure(): void {
    const { layers, state } = this;
    if (!layers || this.disposed) return;
    this.frame(performance.now());
    layers.finish();
    const began = performance.now();
    for (let count = 0; count < MEASURED_FRAMES; count++) {
      const turned = orbit(this.view, 0.1 * (count % 2), 0, this.up);
      layers.render(turned, this.lens, this.width, this.height);
      layers.finish();
    }
    this.invalidate();
    state.frameMs.value = (performance.now() - began) / MEASURED_FRAMES;
  }

  // Navigation.

  navigate(view: Viewpoint): void {
    this.travel = null;
    this.view = view;
    this.back = null;
    this.state.hovered.value = null;
    this.store.lookThrough.value = null;
    this.moved(true);
  }

  /** Go to a viewpoint, visibly unless motion is unwanted. */
  private goTo(view: Viewpoint, animated = true): void {
    if (animated && !matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.travel = { from: this.view, to: view, began: performance.now() };
      this.invalidate();
      return;
    }
    this.travel = null;
    this.view = view;
    this.moved(false);
  }

  /** Go to a viewpoint that the operator chose. */
  visit(view: Viewpoint): void {
    this.leave();
    this.goTo(view);
  }

  /** Show everything. */
  fitAll(): void {
    const { content, view } = this;
    this.leave();
    this.goTo(framing(view, content.centre, content.radius, this.halfAngle()));
  }

  /** Show everything from above, north at the top where it is known. */
  top(): void {
    const { up, north, centre, radius } = this.content;
    const right = north ? cross(north, up) : rotate(this.view.orientation, [1, 0, 0]);
    const level = length(minus(right, times(up, dot(right, up)))) > 1e-3 ? right : across(up);
    this.leave();
    this.goTo(fromAbove(centre, radius / Math.sin(this.halfAngle()), level, up));
  }

  /** Come close to what is selected. */
  focus(): void {
    const marker = this.selectedMarker();
    if (!marker) return;
    this.leave();
    this.goTo(framing(this.view, marker.position, this.frustum * 3, this.halfAngle()));
  }

  /** Look through what is selected. */
  lookThroughSelection(): void {
    const marker = this.selectedMarker();
    if (marker?.orientation)
      this.store.lookThrough.value = { position: marker.position, orientation: marker.orientation };
  }

  private look(camera: SceneStore["lookThrough"]["value"]): void {
    if (camera) {
      this.back ??= this.view;
      this.goTo({ ...camera, distance: this.radius });
    } else this.invalidate();
  }

  private leave(): void {
    this.back = null;
    this.store.lookThrough.value = null;
  }

  private halfAngle(): number {
    const { frame, fx, fy } = this.lens;
    return Math.min(Math.atan(frame.width / (2 * fx)), Math.atan(frame.height / (2 * fy)));
  }

  hover(at: readonly [number, number] | null): void {
    const { state } = this;
    const marker = at && pick(this.content.markers, this.shown(), this.frustum, this.view, this.lens, at);
    if (marker !== (state.hovered.value?.marker ?? null))
      state.hovered.value = marker && at ? { marker, at } : null;
  }

  click(at: readonly [number, number]): void {
    const marker = pick(this.content.markers, this.shown(), this.frustum, this.view, this.lens, at);
    this.store.selection.value = marker?.selects ?? null;
  }

  command(key: string): boolean {
    const commands: Record<string, () => void> = {
      home: () => this.fitAll(),
      0: () => this.fitAll(),
      t: () => this.top(),
      f: () => this.focus(),
      l: () => this.lookThroughSelection(),
      n: () => this.step(1),
      p: () => this.step(-1),
      enter: () => this.choose(),
      escape: () => this.escape(),
    };
    const command = commands[key.toLowerCase()];
    command?.();
    return command !== undefined;
  }

  /** Highlight the next frustum on the canvas. */
  private step(by: number): void {
    const { state, view, lens } = this;
    const markers = pickable(this.content.markers, this.shown(), view, lens, this.width, this.height);
    if (markers.length === 0) return;
    const now = markers.indexOf(state.hovered.value?.marker ?? (this.selectedMarker() as Marker));
    const next = now < 0 && by < 0 ? markers.length - 1 : (now + by + markers.length) % markers.length;
    const marker = markers[next] as Marker;
    state.hovered.value = { marker, at: this.placeOf(marker) };
  }

  private placeOf(marker: Marker): readonly [number, number] {
    const place = project(marker.position, this.view, this.lens);
    return place ? [place[0], place[1]] : [0, 0];
  }

  private choose(): void {
    const { state } = this;
    const marker =
      state.hovered.value?.marker ??
      pick(this.content.markers, this.shown(), this.frustum, this.view, this.lens, [
        this.width / 2,
        this.height / 2,
      ]);
    if (marker?.selects) this.store.selection.value = marker.selects;
  }

  private escape(): void {
    const { back } = this;
    if (this.store.lookThrough.value) {
      this.leave();
      if (back) this.goTo(back);
    } else this.store.selection.value = null;
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
