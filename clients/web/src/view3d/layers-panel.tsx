import { strings } from "../strings";
import { LAYERS } from "./content";
import { SOURCES, type Source, type ViewState } from "./view-state";

const texts = strings.view3d;

/** What is shown, and who draws the splat. */
export function LayersPanel({ state }: { state: ViewState }) {
  return (
    <details class="view3d-panel">
      <summary>{texts.layers}</summary>
      <fieldset aria-label={texts.layers}>
        {LAYERS.map((layer) => (
          <label key={layer} class="check">
            <input
              type="checkbox"
              checked={!state.hidden.value.has(layer)}
              onChange={() => state.toggle(layer)}
            />
            {texts.layer[layer]}
          </label>
        ))}
      </fieldset>
      <label>
        {texts.drawnBy}
        <select
          value={state.source.value}
          onChange={(event) => state.choose(event.currentTarget.value as Source)}
        >
          {SOURCES.map((source) => (
            <option key={source} value={source} disabled={source === "local" && state.gl === "none"}>
              {texts.sources[source]}
            </option>
          ))}
        </select>
      </label>
    </details>
  );
}
