import { effect, type Signal, untracked } from "@preact/signals";
import type { SceneStore } from "../store/scene";
import { areas, type CandidatesForm } from "./candidates-form";

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
