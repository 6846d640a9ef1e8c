import { computed, effect, untracked } from "@preact/signals";
import type { SnapshotCameras, Triple } from "../api/artifacts";
import type { Camera } from "../geometry/frames";
import type { SceneStore } from "../store/scene";
import { theme } from "../theme";
import { carried } from "./carry";
import { contentOf, type Marker } from "./content";
import { forecastOf } from "./forecast";
import { project } from "./lens";
import { ModelSource } from "./model-source";
import { type Navigated, Navigation } from "./navigation";
import { pick, pickable } from "./picking";
import { Stage } from "./stage";
import { firstView, halfAngle, topView, turningView, wholeView } from "./standard-views";
import type { ViewState } from "./view-state";
import { between, framing, lookAt, orbit, type Viewpoint } from "./viewpoint";

const TRAVEL_MS = 450;
const REST_MS = 180;
const MEASURED_FRAMES = 4;

/** The 3D view of a scene: what its stage shows, and from where. It draws only when something has changed. */
export class Viewer implements Navigated {
  view: Viewpoint = lookAt([0, -3, 1], [0, 0, 0], [0, 0, 1]);
  readonly stage: Stage;
  private cameras: SnapshotCameras | null = null;
  private touched = false;
  private back: Viewpoint | null = null;
  private travel: { from: Viewpoint; to: Viewpoint; began: number } | null = null;
  private waiting = 0;
  private resting: ReturnType<typeof setTimeout> | undefined;
  private disposed = false;
  /** Counts what the model was to be drawn by; only the last counts. */
  private turn = 0;
  private readonly source: ModelSource;
  private readonly snapshotId = computed(() => this.store.snapshot.value?.id);
  private readonly navigation: Navigation;
  private readonly observer: ResizeObserver;
  private readonly ends: (() => void)[] = [];

  constructor(
    host: HTMLElement,
    private readonly store: SceneStore,
    private readonly state: ViewState,
  ) {
    const content = untracked(() => contentOf(store));
    this.stage = new Stage(host, state.gl, content, (lost) => {
      state.contextLost.value = lost;
      this.invalidate();
    });
    const last = state.last.get(store.id);
    if (last) {
      this.view = last.view;
      this.cameras = last.cameras;
    }
    this.source = new ModelSource(
      state,
      () => {
        this.stage.setPoints(this.source.points);
        this.invalidate();
      },
      (bitmap) => {
        this.stage.showRender(bitmap);
        this.invalidate();
      },
    );
    this.navigation = new Navigation(host, this);
    this.observer = new ResizeObserver(() => {
      this.stage.resize();
      this.moved(false);
    });
    this.observer.observe(host);
    this.follow();
  }

  get lens() {
    return this.stage.lens;
  }

  get up(): Triple {
    return this.stage.content.up;
  }

  get radius(): number {
    return this.stage.content.radius;
  }

  dispose(): void {
    this.disposed = true;
    for (const end of this.ends) end();
    cancelAnimationFrame(this.waiting);
    clearTimeout(this.resting);
    this.observer.disconnect();
    this.navigation.dispose();
    this.source.restart();
    this.stage.dispose();
    this.state.model.value = { kind: "none" };
    this.state.hovered.value = null;
    this.state.contextLost.value = false;
  }

  /** Follow the store and what is chosen in the view. */
  private follow(): void {
    const { store, state, stage } = this;
    this.ends.push(
      effect(() => this.showContent()),
      effect(() => this.loadPoints()),
      effect(() => this.showModel()),
      effect(() => {
        const forecast = forecastOf(store);
        untracked(() => stage.setSamples(forecast?.samples ?? []));
        this.invalidate();
      }),
      effect(() => {
        theme.value;
        untracked(() => stage.redraw());
        this.invalidate();
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

  private showContent(): void {
    const { store } = this;
    const cameras = store.cameras.value;
    // The cameras of a snapshot come after it: until then everything stays in the frame of the one before.
    if (store.snapshot.value !== null && cameras === null) return;
    const content = contentOf(store);
    untracked(() => {
      this.stage.setContent(content);
      this.keepViewpoint(cameras);
      this.highlight();
    });
  }

  /**
   * A new model is seen from where the one before was.
   *
   * Before there is one, all positions are in view as they come, until the operator moves.
   */
  private keepViewpoint(cameras: SnapshotCameras | null): void {
    const before = this.cameras;
    this.cameras = cameras;
    let kept: Viewpoint | null = null;
    if (before === cameras) kept = cameras || this.touched ? this.view : null;
    else if (before && cameras) kept = carried(this.view, before, cameras);
    if (kept) {
      this.view = kept;
      if (before !== cameras) this.moved(false);
    } else if (cameras || this.stage.content.markers.length > 0) {
      this.goTo(firstView(this.stage.content, cameras, this.stage.frustum, this.lens), false);
    }
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
    const { state } = this;
    const id = this.snapshotId.value;
    const lost = state.contextLost.value;
    const local = state.local.value && !lost;
    const turn = ++this.turn;
    untracked(async () => {
      await this.stage.useWebgl(local || (state.gl === "hardware" && !lost));
      if (turn === this.turn && !this.disposed) this.showModelOf(id, local);
    });
  }

  private showModelOf(id: string | undefined, local: boolean): void {
    const { state, source, stage } = this;
    const { layers } = stage;
    if (id !== undefined && local && layers) {
      stage.forgetRender();
      const onDirty = () => this.invalidate();
      void source.loadSplat(id, layers, onDirty).then((drawn) => drawn && this.measure());
      return;
    }
    layers?.set("splat", null);
    if (id === undefined) {
      stage.forgetRender();
      source.restart();
      state.model.value = { kind: "none" };
    } else {
      source.useService(id);
      this.moved(false);
    }
  }

  private highlight(): void {
    const selected = this.selectedMarker();
    const hovered = this.state.hovered.value?.marker;
    this.stage.setHighlighted([selected, hovered].filter((one) => one !== undefined));
    this.invalidate();
  }

  private selectedMarker(): Marker | undefined {
    const wanted = JSON.stringify(this.store.selection.value);
    return this.stage.content.markers.find((one) => one.selects && JSON.stringify(one.selects) === wanted);
  }

  // Frames.

  /** Draw a frame soon. */
  private invalidate(): void {
    if (!this.waiting && !this.disposed) this.waiting = requestAnimationFrame((now) => this.frame(now));
  }

  private frame(now: number): void {
    this.waiting = 0;
    if (this.travel) this.goOn(this.travel, now);
    const framed = this.store.lookThrough.peek() !== null && this.travel === null;
    this.stage.draw(this.view, this.state.shown.peek(), framed);
  }

  private goOn({ from, to, began }: { from: Viewpoint; to: Viewpoint; began: number }, now: number): void {
    const share = Math.min(1, Math.max(0, now - began) / TRAVEL_MS);
    if (share === 1) {
      this.view = to;
      this.travel = null;
    } else this.view = between(from, to, share * share * (3 - 2 * share));
    this.moved(this.travel !== null);
  }

  /** The view has moved: the service renders a small image, and the large one when it rests. */
  private moved(moving: boolean): void {
    this.invalidate();
    clearTimeout(this.resting);
    if (this.cameras === null) return; // without a model there is nothing to render
    this.source.request(this.view, moving, this.stage.renderSize);
    if (moving) this.resting = setTimeout(() => this.moved(false), REST_MS);
    else this.state.last.set(this.store.id, { view: this.view, cameras: this.cameras });
  }

  /** Measure how long a frame takes while the view turns; where that is long the service draws. */
  private measure(): void {
    const { layers, width, height } = this.stage;
    if (!layers || this.disposed) return;
    const draw = (yaw: number) => {
      layers.render(orbit(this.view, yaw, 0, this.up), this.lens, width, height);
      layers.finish();
    };
    draw(0);
    const began = performance.now();
    for (let count = 0; count < MEASURED_FRAMES; count++) draw(0.1 * (count % 2));
    this.state.frameMs.value = (performance.now() - began) / MEASURED_FRAMES;
    this.invalidate();
  }

  // Navigation.

  navigate(view: Viewpoint): void {
    this.touched = true;
    this.travel = null;
    this.view = view;
    this.state.hovered.value = null;
    this.leave();
    this.moved(true);
  }

  /** Go to a viewpoint that the operator chose. */
  visit(view: Viewpoint): void {
    this.touched = true;
    this.leave();
    this.goTo(view);
  }

  /** Show everything. */
  fitAll(): void {
    this.visit(wholeView(this.stage.content, this.view, this.lens));
  }

  /** Show everything from above. */
  top(): void {
    this.visit(topView(this.stage.content, this.view, this.lens));
  }

  /** Come close to what is selected. */
  focus(): void {
    const marker = this.selectedMarker();
    if (marker) this.visit(framing(this.view, marker.position, this.stage.frustum * 3, halfAngle(this.lens)));
  }

  private lookThroughSelection(): void {
    const marker = this.selectedMarker();
    if (marker?.orientation)
      this.store.lookThrough.value = { position: marker.position, orientation: marker.orientation };
  }

  private look(camera: Camera | null): void {
    this.invalidate();
    if (!camera) return;
    this.back ??= this.view;
    this.goTo(turningView(camera, this.stage.content, this.stage.frustum));
  }

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

  private leave(): void {
    this.back = null;
    this.store.lookThrough.value = null;
  }

  // Picking.

  private markerAt(at: readonly [number, number]): Marker | null {
    const { content, frustum } = this.stage;
    return pick(
      content.markers,
      this.stage.shown(this.state.shown.peek()),
      frustum,
      this.view,
      this.lens,
      at,
    );
  }

  hover(at: readonly [number, number] | null): void {
    const { hovered } = this.state;
    const marker = at && this.markerAt(at);
    if (marker !== (hovered.value?.marker ?? null)) hovered.value = marker && at ? { marker, at } : null;
  }

  click(at: readonly [number, number]): void {
    this.store.selection.value = this.markerAt(at)?.selects ?? null;
  }

  command(key: string): boolean {
    const commands: Record<string, () => void> = {
      home: () => this.fitAll(),
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

  /** Highlight the next frustum on the canvas, or the one before. */
  private step(by: number): void {
    const { state, view, lens, stage } = this;
    const shown = stage.shown(state.shown.peek());
    const markers = pickable(stage.content.markers, shown, view, lens, stage.width, stage.height);
    const current = state.hovered.value?.marker ?? this.selectedMarker();
    const now = current ? markers.indexOf(current) : -1;
    const next = now < 0 && by < 0 ? markers.length - 1 : (now + by + markers.length) % markers.length;
    const marker = markers[next];
    const place = marker && project(marker.position, view, lens);
    if (place) state.hovered.value = { marker, at: [place[0], place[1]] };
  }

  private choose(): void {
    const { width, height } = this.stage;
    const marker = this.state.hovered.value?.marker ?? this.markerAt([width / 2, height / 2]);
    if (marker?.selects) this.store.selection.value = marker.selects;
  }

  private escape(): void {
    const { back } = this;
    if (this.store.lookThrough.value === null) this.store.selection.value = null;
    this.leave();
    if (back) this.goTo(back);
  }
}
