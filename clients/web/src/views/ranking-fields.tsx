import { CheckField, NumberField, SelectField } from "../components/fields";
import { formatDate } from "../components/format";
import { PickPlace } from "../components/pick-place";
import { capabilities } from "../store/capabilities";
import type { SceneStore } from "../store/scene";
import { strings } from "../strings";
import { ConstraintFields, GeneratorFields, SourceFields } from "./candidates-fields";
import { SOURCES } from "./candidates-form";
import { RANKING, type RankingForm, STARTS } from "./ranking-form";
import { rankingRun } from "./ranking-run";
import { metric } from "./site";

const texts = strings.views.form;

/** The fields of a ranking's form. */
export function RankingFields({ store }: { store: SceneStore }) {
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

/** The model that is shown, ranked and planned for. */
export function SnapshotField({ store }: { store: SceneStore }) {
  const snapshots = store.snapshots.value;
  const chosen = snapshots.some(({ id }) => id === store.chosenSnapshot.value)
    ? (store.chosenSnapshot.value ?? "")
    : "";
  return (
    <SelectField
      label={texts.snapshot}
      value={chosen}
      onValue={(id) => {
        store.chosenSnapshot.value = id || null;
      }}
      options={[
        { value: "", title: texts.newest },
        ...snapshots.map(({ id, created_at }) => ({ value: id, title: formatDate(created_at) })),
      ]}
    />
  );
}
