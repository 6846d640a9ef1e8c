import { signal } from "@preact/signals";
import type { Drawing, SceneStore } from "../store/scene";
import { strings } from "../strings";
import type { MapContents } from "./contents";
import { crossesItself, type Flat, MOST_CORNERS } from "./polygons";

export const USES = ["area", "corridor", "fence", "no-fly"] as const;

/** Drawing on the map: what is being drawn, and changes to what was drawn. */
export class Sketch {
  /** What is being drawn; null when nothing is. */
  readonly use = signal<Drawing["use"] | null>(null);
  readonly corners = signal<readonly Flat[]>([]);
  /** The corner of the chosen drawing that is being moved, and where it is now. */
  readonly held = signal<{ index: number; at: Flat } | null>(null);
  /** Why the last step was refused. */
  readonly refusal = signal<string | null>(null);

  constructor(
    private readonly store: SceneStore,
    private readonly contents: MapContents,
  ) {}

  begin(use: Drawing["use"]): void {
    this.use.value = use;
    this.corners.value = [];
    this.refusal.value = null;
    this.store.chosenDrawing.value = null;
  }

  cancel(): void {
    this.use.value = null;
    this.corners.value = [];
    this.held.value = null;
    this.refusal.value = null;
  }

  add(corner: Flat): void {
    if (this.corners.value.length >= MOST_CORNERS)
      this.refusal.value = strings.map.tooManyCorners(MOST_CORNERS);
    else {
      this.corners.value = [...this.corners.value, corner];
      this.refusal.value = null;
    }
  }

  removeLast(): void {
    this.corners.value = this.corners.value.slice(0, -1);
    this.refusal.value = null;
  }

  /** End the drawing; what cannot be used stays to be corrected, with a reason. */
  finish(): void {
    const use = this.use.value;
    if (use === null) return;
    this.refusal.value = refusalOf(use, this.corners.value);
    if (this.refusal.value !== null) return;
    this.keep(use, this.corners.value);
    this.cancel();
  }

  /** A new drawing with these corners, which becomes the chosen one. */
  keep(use: Drawing["use"], corners: readonly Flat[], heights: Partial<Drawing> = {}): void {
    const drawing: Drawing = {
      id: `drawing-${Date.now()}-${this.store.drawings.value.length}`,
      use,
      corners: corners.map((corner) => this.placeOf(corner)),
      ...this.usualHeights(use),
      ...heights,
    };
    this.store.drawings.value = [...this.store.drawings.value, drawing];
    this.store.chosenDrawing.value = drawing.id;
  }

  change(id: string, part: Partial<Drawing>): void {
    this.store.drawings.value = this.store.drawings.value.map((one) =>
      one.id === id ? { ...one, ...part } : one,
    );
  }

  remove(id: string): void {
    this.store.drawings.value = this.store.drawings.value.filter((one) => one.id !== id);
    if (this.store.chosenDrawing.value === id) this.store.chosenDrawing.value = null;
  }

  /** Put other corners in place of the chosen drawing's; refused, with a reason, where they cannot be used. */
  reshape(corners: readonly Flat[]): void {
    const drawing = this.store.drawings.value.find((one) => one.id === this.store.chosenDrawing.value);
    if (!drawing) return;
    this.refusal.value = refusalOf(drawing.use, corners);
    if (this.refusal.value === null)
      this.change(drawing.id, { corners: corners.map((corner) => this.placeOf(corner)) });
  }

  /** The corners of the chosen drawing as they are being moved. */
  chosenCorners(): readonly Flat[] {
    const id = this.store.chosenDrawing.value;
    const corners = this.contents.drawings.value.find((one) => one.drawing.id === id)?.corners ?? [];
    const held = this.held.value;
    return held === null ? corners : corners.map((corner, i) => (i === held.index ? held.at : corner));
  }

  /** The middles of the edges of the chosen drawing. */
  middles(): Flat[] {
    const corners = this.chosenCorners();
    const drawing = this.store.drawings.value.find((one) => one.id === this.store.chosenDrawing.value);
    const edges = drawing?.use === "corridor" ? corners.slice(0, -1) : corners;
    return edges.map((a, i): Flat => {
      const b = corners[(i + 1) % corners.length] as Flat;
      return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
    });
  }

  /** A new corner of the chosen drawing, before the one with an index. */
  insert(index: number, corner: Flat): void {
    this.reshape(this.chosenCorners().toSpliced(index, 0, corner));
  }

  /** How far a new corridor would reach to its sides. */
  radius(): number {
    return this.usualHeights("corridor").radius_m;
  }

  /** Leave the held corner where it is. */
  drop(): void {
    const corners = this.chosenCorners();
    this.held.value = null;
    this.reshape(corners);
  }

  private placeOf([x, y]: Flat): Drawing["corners"][number] {
    const place = this.contents.frame.value.placeOf([x, y, 0]);
    if (place === null) throw new Error(strings.map.noPlace);
    const { latitude_deg, longitude_deg } = place;
    return { latitude_deg, longitude_deg };
  }

  /** Heights around those of the photographs; a zone reaches from the ground to above them. */
  private usualHeights(use: Drawing["use"]): Pick<Drawing, "lower_m" | "upper_m" | "radius_m"> {
    const ground = this.contents.ground.value?.typical ?? 0;
    const { height: flight, above } = this.contents.flight.value;
    const [lower, upper] =
      use === "no-fly"
        ? [ground - 5, ground + 2 * above]
        : use === "corridor"
          ? [flight, flight]
          : [ground + 0.75 * above, ground + 1.25 * above];
    return {
      lower_m: Math.round(lower),
      upper_m: Math.round(upper),
      radius_m: Math.max(5, Math.round(above / 4)),
    };
  }
}

/** Why corners cannot be used; null when they can. */
export function refusalOf(use: Drawing["use"], corners: readonly Flat[]): string | null {
  const { map } = strings;
  if (corners.length > MOST_CORNERS) return map.tooManyCorners(MOST_CORNERS);
  if (use === "corridor") return corners.length < 2 ? map.corridorNeedsTwo : null;
  if (corners.length < 3) return map.polygonNeedsThree;
  return crossesItself(corners) ? map.crossesItself : null;
}
