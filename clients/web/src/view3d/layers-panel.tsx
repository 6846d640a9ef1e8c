import { CheckField, SelectField } from "../components/fields";
import { strings } from "../strings";
import { LAYERS } from "./content";
import { SOURCES, type ViewState } from "./view-state";

const texts = strings.view3d;

/** What is shown, and who draws the splat. */
export function LayersPanel({ state }: { state: ViewState }) {
  return (
    <details class="view3d-panel">
      <summary>{texts.layers}</summary>
      <fieldset aria-label={texts.layers}>
        {LAYERS.map((layer) => (
          <CheckField
            key={layer}
            checked={!state.hidden.value.has(layer)}
            onChecked={() => state.toggle(layer)}
          >
            {texts.layer[layer]}
          </CheckField>
        ))}
      </fieldset>
      <SelectField
        label={texts.drawnBy}
        value={state.source.value}
        onValue={(source) => state.choose(source)}
        options={SOURCES.map((value) => ({
          value,
          title: texts.sources[value],
          disabled: value === "local" && state.gl === "none",
        }))}
      />
    </details>
  );
}
