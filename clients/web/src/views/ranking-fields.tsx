import { ConstraintFields, GeneratorFields, SourceFields } from "../candidates/candidates-fields";
import { SOURCES } from "../candidates/candidates-form";
import { SnapshotField } from "../candidates/model-choice";
import { metric, STARTS } from "../candidates/site";
import { CheckField, NumberField, SelectField } from "../components/fields";
import { PickPlace } from "../components/pick-place";
import { capabilities } from "../store/capabilities";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";
import { RANKING, type RankingForm } from "./ranking-form";
import { rankingRun } from "./ranking-run";

const texts = strings.views.form;

/** The fields of a ranking's form. */
export function RankingFields({ store }: SceneProps) {
  const { form: state } = rankingRun(store);
  const form = state.value;
  const set = (change: Partial<RankingForm>) => {
    state.value = { ...state.peek(), ...change };
  };
  const unit = strings.views.unit[metric(store) ? "metres" : "units"];
  const drawings = store.drawings.value;
  const methods = capabilities.value?.methods ?? [RANKING.method];
  const onEarth = store.frames.value?.georeferenced ?? false;
  const candidates = {
    form: form.candidates,
    onChange: (candidates: RankingForm["candidates"]) => set({ candidates }),
  };
  return (
    <>
      <SelectField
        label={texts.method}
        value={form.method}
        onValue={(method) => set({ method })}
        options={methods.map((value) => ({ value, title: strings.views.methods[value].title }))}
        hint={strings.views.methods[form.method].prefers}
      />
      <SourceFields {...candidates} sources={SOURCES} drawings={drawings} />
      <div class="fields">
        <NumberField label={texts.k} value={form.k} onValue={(k) => set({ k })} min={1} max={100} step={1} />
        <SelectField
          label={texts.start}
          value={form.start}
          onValue={(start) => set({ start })}
          options={STARTS.map((value) => ({
            value,
            title: strings.views.starts[value],
            disabled: value === "place" && !onEarth,
          }))}
        />
      </div>
      {form.start === "place" && (
        <PickPlace store={store} place={form.place} onPlace={(place) => set({ place })} />
      )}
      <details>
        <summary>{texts.more}</summary>
        <div class="fields">
          <GeneratorFields {...candidates} unit={unit} />
          <NumberField
            label={texts.radius(unit)}
            value={form.radius}
            onValue={(radius) => set({ radius })}
            min={0}
            placeholder={form.candidates.source === "around-current" ? texts.automatic : texts.unlimited}
          />
          <ConstraintFields {...candidates} drawings={drawings} unit={unit} />
          <SnapshotField store={store} />
        </div>
        <CheckField checked={form.rankAll} onChecked={(rankAll) => set({ rankAll })}>
          {texts.rankAll}
        </CheckField>
      </details>
    </>
  );
}
