import { effect, type Signal, untracked } from "@preact/signals";
import type { Schemas } from "../api/service";
import type { Drawing, SceneStore } from "../store/scene";
import { strings } from "../strings";
import { drawingVolume } from "./drawing-volume";
import { boxAround, type Site } from "./site";
import { FormError, given, numberOf } from "./values";

/** Where candidates come from: generators, of which two are `in-volume`. */
export const SOURCES = ["orbit", "grid", "dataset", "around-current", "box", "drawing"] as const;
export type Source = (typeof SOURCES)[number];

/** What a form says of candidates; empty fields leave the choice to the service. */
export interface CandidatesForm {
  source: Source;
  count: string;
  radius: string;
  height: string;
  columns: string;
  rows: string;
  gridLook: "centre" | "down";
  look: "middle" | "nearest";
  level: boolean;
  /** The id of the drawn area or corridor. */
  drawing: string;
  safety: string;
  /** Whether candidates stay out of the drawn no-fly zones. */
  noFly: boolean;
}

export const CANDIDATES: CandidatesForm = {
  source: "orbit",
  count: "",
  radius: "",
  height: "",
  columns: "",
  rows: "",
  gridLook: "centre",
  look: "middle",
  level: false,
  drawing: "",
  safety: "",
  noFly: true,
};

const BOX_MARGIN = 0.1;

export type Generator = NonNullable<Schemas["RankingRequest"]["generator"]>;

/** The drawings in which candidates can be made. */
export function areas(drawings: readonly Drawing[]): readonly Drawing[] {
  return drawings.filter(({ use }) => use === "area" || use === "corridor");
}

/** The generator that a form describes. Throws `FormError`. */
export function generatorOf(form: CandidatesForm, site: Site): Generator {
  const count = numberOf(form.count);
  const height_m = numberOf(form.height);
  switch (form.source) {
    case "orbit":
      return { kind: "orbit", ...given({ count, radius_m: numberOf(form.radius), height_m }) };
    case "grid": {
      const size = { columns: numberOf(form.columns), rows: numberOf(form.rows) };
      return { kind: "grid", ...given({ ...size, height_m }), look: form.gridLook };
    }
    case "dataset":
      return { kind: "dataset" };
    case "around-current":
      return { kind: "around-current", ...given({ count }) };
    case "box":
    case "drawing": {
      const volume = form.source === "box" ? boxAround(site, BOX_MARGIN) : drawnVolume(form, site);
      return { kind: "in-volume", volume, count: count ?? 100, look: form.look, level: form.level };
    }
  }
}

/** The number of candidates that a generator makes, at most; null where only the service knows. */
export function expectedOf(generator: Generator): number | null {
  switch (generator.kind) {
    case "orbit":
      return generator.count ?? 24;
    case "grid":
      return (generator.columns ?? 6) * (generator.rows ?? 6);
    case "around-current":
      return generator.count ?? 32;
    case "in-volume":
      return generator.count ?? 300;
    default:
      return null;
  }
}

/** Where candidates may be: the safety distance, and the drawn no-fly zones where there are any. */
export function constraintsOf(
  form: CandidatesForm,
  site: Site,
): Pick<Schemas["RankingRequest"], "safety_m" | "no_fly"> {
  const zones = form.noFly ? site.drawings.filter(({ use }) => use === "no-fly") : [];
  const safety_m = numberOf(form.safety);
  return {
    ...given({ safety_m }),
    ...(zones.length > 0 && { no_fly: zones.map((zone) => drawingVolume(zone, site.frames)) }),
  };
}

function drawnVolume(form: CandidatesForm, site: Site): Schemas["Prism"] | Schemas["Corridor"] {
  const drawn = areas(site.drawings);
  const drawing = drawn.find(({ id }) => id === form.drawing) ?? drawn[0];
  if (!drawing) throw new FormError(strings.views.form.nothingDrawn);
  return drawingVolume(drawing, site.frames);
}

/** Let a form make its candidates in an area or a corridor as soon as that is chosen on the map. */
export function followChosenDrawing<Form extends { candidates: CandidatesForm }>(
  store: SceneStore,
  form: Signal<Form>,
): void {
  effect(() => {
    const chosen = store.chosenDrawing.value;
    untracked(() => {
      const drawing = areas(store.drawings.value).find(({ id }) => id === chosen);
      if (!drawing) return;
      const change = { source: "drawing" as const, drawing: drawing.id, look: "nearest" as const };
      form.value = { ...form.value, candidates: { ...form.value.candidates, ...change } };
    });
  });
}
