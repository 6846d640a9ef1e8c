import { batch, computed, signal } from "@preact/signals";
import type { SceneStore } from "../store/scene";
import { theme } from "../theme";
import { MapContents } from "./contents";
import { forecastValue } from "./forecast-grid";
import { gapAt, valueAt } from "./ground-grid";
import { shownLayers } from "./layers";
import type { Picture } from "./paint";
import { palette } from "./palette";
import { distanceToSegment, type Flat, isInside } from "./polygons";
import { Sketch } from "./sketch";
import { fitted, fromScreen, moved, toScreen, type Viewport, zoomed } from "./viewport";

const LEAST_M = 20;
/** Fewer photographs than this at a place are a gap: a point needs two rays, and a third to check them. */
export const ENOUGH = 3;
/** From this share on of what a forecast does not know, a place is a gap. */
const MUCH = 2 / 3;

/** A place that photographs or the model cover too little, and what is around it. */
export interface Gap {
  kind: "overlap" | "variance" | "dB";
  value: number;
  corners: Flat[];
}

/** The map of a scene: what it shows, which part, and what the operator does on it. */
export class MapState {
  readonly contents: MapContents;
  readonly sketch: Sketch;
  readonly view = signal<Viewport>({ centre: [0, 0], pxPerUnit: 1, width: 1, height: 1 });
  /** Where the pointer is on the screen; null when it is not on the map. */
  readonly pointer = signal<Flat | null>(null);
  readonly byKeys = signal(false);
  /** Whether tiles are shown below. */
  readonly tiles = signal(false);
  readonly gap = signal<Gap | null>(null);
  private readonly chosen = signal(false);

  constructor(readonly store: SceneStore) {
    this.contents = new MapContents(store);
    this.sketch = new Sketch(store, this.contents);
  }

  readonly picture = computed((): Picture => {
    const { store, contents, sketch } = this;
    const chosen = store.drawings.value.find((one) => one.id === store.chosenDrawing.value);
    const use = sketch.use.value;
    return {
      view: this.view.value,
      contents: contents.painted.value,
      layers: shownLayers.value,
      selection: store.selection.value,
      colours: palette(),
      theme: theme.value,
      tiles: this.tiles.value,
      chosenDrawing: chosen?.id ?? null,
      middles: chosen && use === null ? sketch.middles() : [],
      gap: this.gap.value,
      pointer: this.byKeys.value || use !== null ? this.pointer.value : null,
      byKeys: this.byKeys.value,
      sketch: use
        ? { use, corners: sketch.corners.value, finished: false, radius: sketch.radius() }
        : chosen
          ? { use: chosen.use, corners: sketch.chosenCorners(), finished: true, radius: chosen.radius_m }
          : null,
    };
  });

  resize(width: number, height: number): void {
    this.view.value = { ...this.view.value, width, height };
    this.fitUnlessChosen();
  }

  /** Show everything, as long as the operator has not chosen a part. */
  fitUnlessChosen(): void {
    if (!this.chosen.peek()) this.fit();
  }

  fit(): void {
    const least = this.contents.frame.peek().metric ? LEAST_M : 1;
    this.chosen.value = false;
    this.view.value = fitted(this.view.peek(), this.contents.everything.peek(), least);
  }

  pan(du: number, dv: number): void {
    this.chosen.value = true;
    this.view.value = moved(this.view.value, du, dv);
  }

  zoom(factor: number, at: Flat = [this.view.value.width / 2, this.view.value.height / 2]): void {
    this.chosen.value = true;
    this.view.value = zoomed(this.view.value, factor, at);
  }

  /** Move the pointer by keys; at the border the map moves instead. */
  movePointer(du: number, dv: number): void {
    const { width, height } = this.view.value;
    const [u, v] = this.pointer.value ?? [width / 2, height / 2];
    const [nextU, nextV] = [Math.min(width, Math.max(0, u + du)), Math.min(height, Math.max(0, v + dv))];
    batch(() => {
      this.byKeys.value = true;
      this.pan(nextU - u - du, nextV - v - dv);
      this.pointAt([nextU, nextV]);
    });
  }

  pointAt(at: Flat): void {
    this.pointer.value = at;
    const held = this.sketch.held.value;
    if (held) this.sketch.held.value = { ...held, at: fromScreen(this.view.value, at) };
  }

  /** What a click or Enter does at a place of the screen; `reach` is how far from it things are meant, in px. */
  click(at: Flat, reach: number): void {
    if (this.sketch.use.value !== null) this.setCorner(at, reach);
    else if (!this.givePlace(at)) this.pick(at, reach);
  }

  /** Take hold of the corner of the chosen drawing at a place, or of the middle of an edge, as a new corner. */
  hold(at: Flat, reach: number): boolean {
    const corners = this.sketch.chosenCorners();
    if (this.sketch.use.value !== null || !corners.length) return false;
    const near = (corner: Flat) => this.distance(corner, at) <= reach;
    let index = corners.findIndex(near);
    if (index < 0) {
      const middle = this.sketch.middles().findIndex(near);
      if (middle < 0) return false;
      index = middle + 1;
      this.sketch.insert(index, this.sketch.middles()[middle] as Flat);
    }
    this.sketch.held.value = { index, at: fromScreen(this.view.value, at) };
    return true;
  }

  /** Remove the corner at a place from the chosen drawing. */
  removeCorner(at: Flat, reach: number): void {
    const corners = this.sketch.chosenCorners();
    const index = corners.findIndex((corner) => this.distance(corner, at) <= reach);
    if (index >= 0) this.sketch.reshape(corners.filter((_, i) => i !== index));
  }

  /** End what is under way: a drawing, else a choice. */
  escape(): void {
    if (this.sketch.use.value !== null || this.sketch.held.value !== null) this.sketch.cancel();
    else {
      this.gap.value = null;
      this.store.selection.value = null;
      this.store.chosenDrawing.value = null;
    }
  }

  /** Give the place to what waits for one; false when nothing does, or the map is not on Earth. */
  private givePlace(at: Flat): boolean {
    const [x, y] = fromScreen(this.view.value, at);
    const place = this.contents.frame.value.placeOf([x, y, 0]);
    const wanted = this.store.pick.value;
    if (place === null || wanted === null) return false;
    this.store.pick.value = null;
    wanted({ latitude_deg: place.latitude_deg, longitude_deg: place.longitude_deg });
    return true;
  }

  private setCorner(at: Flat, reach: number): void {
    const corners = this.sketch.corners.value;
    const [first, last] = [corners[0], corners.at(-1)];
    const again = last !== undefined && this.distance(last, at) <= reach;
    const closes = corners.length > 2 && first !== undefined && this.distance(first, at) <= reach;
    if (again || closes) {
      if (corners.length > 1) this.sketch.finish();
    } else this.sketch.add(fromScreen(this.view.value, at));
  }

  private pick(at: Flat, reach: number): void {
    const { store } = this;
    const nearest = this.selectable()
      .map((one) => ({ ...one, distance: this.distance(one.at, at) }))
      .filter((one) => one.distance <= reach)
      .sort((a, b) => a.distance - b.distance)[0];
    batch(() => {
      this.gap.value = null;
      store.chosenDrawing.value = null;
      store.selection.value = nearest?.selection ?? null;
      if (nearest) return;
      const place = fromScreen(this.view.value, at);
      const drawing = this.drawingAt(place, reach);
      if (drawing?.onBorder) store.chosenDrawing.value = drawing.id;
      else {
        this.gap.value = this.gapAt(place);
        if (this.gap.value === null) store.chosenDrawing.value = drawing?.id ?? null;
      }
    });
  }

  private selectable() {
    const { contents } = this;
    const layers = shownLayers.value;
    const stops = layers.has("plan") ? contents.tours.value.flatMap((tour) => tour.stops) : [];
    const candidates = layers.has("candidates") ? contents.candidates.value : [];
    const photographs = layers.has("photographs") ? contents.photographs.value : [];
    return [
      ...stops.map(({ id, at }) => ({ at, selection: { kind: "stop" as const, id } })),
      ...candidates.map(({ id, at }) => ({ at, selection: { kind: "candidate" as const, id } })),
      ...photographs.map(({ digest, at }) => ({ at, selection: { kind: "image" as const, digest } })),
    ];
  }

  private drawingAt(place: Flat, reach: number): { id: string; onBorder: boolean } | null {
    if (!shownLayers.value.has("drawings")) return null;
    let within: string | null = null;
    for (const { drawing, corners } of this.contents.drawings.value) {
      const line = drawing.use === "corridor";
      const ends = line ? corners.slice(0, -1) : corners;
      const distance = Math.min(
        ...ends.map((corner, i) =>
          distanceToSegment(place, corner, corners[(i + 1) % corners.length] as Flat),
        ),
      );
      if (distance * this.view.value.pxPerUnit <= reach) return { id: drawing.id, onBorder: true };
      if (line ? distance <= drawing.radius_m : isInside(place, corners)) within = drawing.id;
    }
    return within === null ? null : { id: within, onBorder: false };
  }

  private gapAt(place: Flat): Gap | null {
    const reach = this.contents.flight.value.above; // about the size of a footprint, to each side
    const grid = shownLayers.value.has("overlap") ? this.contents.overlap.value : null;
    const corners = grid && gapAt(grid, place, (count) => count < ENOUGH, reach);
    if (corners) return { kind: "overlap", value: valueAt(grid, place), corners };
    const forecast = shownLayers.value.has("forecast") ? this.contents.forecast.value : null;
    const unknown = forecast && gapAt(forecast.grid, place, (share) => share >= MUCH, reach);
    if (!unknown) return null;
    const value = forecastValue(forecast, valueAt(forecast.grid, place));
    return { kind: forecast.unit, value, corners: unknown };
  }

  private distance(point: Flat, at: Flat): number {
    const [u, v] = toScreen(this.view.value, point);
    return Math.hypot(u - at[0], v - at[1]);
  }
}
