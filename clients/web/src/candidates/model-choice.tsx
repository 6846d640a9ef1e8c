import { SelectField } from "../components/fields";
import { formatDate } from "../components/format";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";

const texts = strings.views;

/** What to do in a scene without a model. */
export function NoModel() {
  return (
    <p>
      {texts.noModel} <span class="hint">{texts.noModelHint}</span>
    </p>
  );
}

/** The model that is shown, ranked and planned for. */
export function SnapshotField({ store }: SceneProps) {
  const snapshots = store.snapshots.value;
  const chosen = snapshots.some(({ id }) => id === store.chosenSnapshot.value)
    ? (store.chosenSnapshot.value ?? "")
    : "";
  return (
    <SelectField
      label={texts.form.snapshot}
      value={chosen}
      onValue={(id) => {
        store.chosenSnapshot.value = id || null;
      }}
      options={[
        { value: "", title: texts.form.newest },
        ...snapshots.map(({ id, created_at }) => ({ value: id, title: formatDate(created_at) })),
      ]}
    />
  );
}
