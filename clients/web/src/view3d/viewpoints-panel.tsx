import { useState } from "preact/hooks";
import type { SceneStore } from "../store/scene";
import { strings } from "../strings";
import { framesOf } from "./content";
import { inModel, inWorld, type SavedViewpoint, savedViewpoints, saveViewpoints } from "./view-state";
import type { Viewer } from "./viewer";

const texts = strings.view3d.viewpoints;

/** Viewpoints that the operator keeps under names, in this browser. */
export function ViewpointsPanel({ store, viewer }: { store: SceneStore; viewer: Viewer }) {
  const [saved, setSaved] = useState(() => savedViewpoints(store.id));
  const keep = (viewpoints: readonly SavedViewpoint[]) => {
    saveViewpoints(store.id, viewpoints);
    setSaved(viewpoints);
  };
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    const form = event.currentTarget as HTMLFormElement;
    const name = String(new FormData(form).get("name")).trim() || texts.unnamed(saved.length + 1);
    const others = saved.filter((one) => one.name !== name);
    keep([...others, inWorld(name, viewer.view, framesOf(store))]);
    form.reset();
  };
  return (
    <details class="view3d-panel">
      <summary>{texts.title}</summary>
      <ul>
        {saved.map((one) => (
          <li key={one.name}>
            <button type="button" onClick={() => viewer.visit(inModel(one, framesOf(store)))}>
              {one.name}
            </button>
            <button
              type="button"
              class="quiet"
              aria-label={texts.delete(one.name)}
              onClick={() => keep(saved.filter((other) => other !== one))}
            >
              ×
            </button>
          </li>
        ))}
      </ul>
      <form onSubmit={submit}>
        <label>
          {texts.name}
          <input name="name" autocomplete="off" maxLength={60} />
        </label>
        <button type="submit">{texts.save}</button>
      </form>
    </details>
  );
}
