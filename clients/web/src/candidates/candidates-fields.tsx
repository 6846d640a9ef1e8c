import { CheckField, NumberField, SelectField } from "../components/fields";
import type { Drawing } from "../store/scene";
import { strings } from "../strings";
import { areas, type CandidatesForm, type Source } from "./candidates-form";

interface CandidatesFieldsProps {
  form: CandidatesForm;
  onChange: (form: CandidatesForm) => void;
  /** The unit of lengths. */
  unit: string;
}

interface SourceFieldsProps extends Omit<CandidatesFieldsProps, "unit"> {
  sources: readonly Source[];
  drawings: readonly Drawing[];
}

const texts = strings.views.form;

/** Where candidates come from. */
export function SourceFields({ form, onChange, sources, drawings }: SourceFieldsProps) {
  const drawn = areas(drawings);
  return (
    <>
      <SelectField
        label={texts.source}
        value={form.source}
        onValue={(source) => onChange({ ...form, source })}
        options={sources.map((value) => {
          const missing = value === "drawing" && drawn.length === 0;
          const title = strings.views.sources[value];
          return { value, title: missing ? texts.drawFirst(title) : title, disabled: missing };
        })}
      />
      {form.source === "drawing" && drawn.length > 1 && (
        <SelectField
          label={texts.drawing}
          value={form.drawing || (drawn[0]?.id ?? "")}
          onValue={(drawing) => onChange({ ...form, drawing })}
          options={drawn.map(({ id, use }, index) => ({
            value: id,
            title: texts.drawn[use as "area" | "corridor"](index + 1),
          }))}
        />
      )}
    </>
  );
}

/** The settings of the generator that makes candidates. */
export function GeneratorFields({ form, onChange, unit }: CandidatesFieldsProps) {
  const set = (change: Partial<CandidatesForm>) => onChange({ ...form, ...change });
  const count = (usual: number) => (
    <NumberField
      label={texts.count}
      value={form.count}
      onValue={(count) => set({ count })}
      min={1}
      step={1}
      placeholder={String(usual)}
    />
  );
  const height = (
    <NumberField
      label={texts.height(unit)}
      value={form.height}
      onValue={(height) => set({ height })}
      placeholder={texts.automatic}
    />
  );
  switch (form.source) {
    case "orbit":
      return (
        <>
          {count(24)}
          <NumberField
            label={texts.orbitRadius(unit)}
            value={form.radius}
            onValue={(radius) => set({ radius })}
            min={0}
            placeholder={texts.automatic}
          />
          {height}
        </>
      );
    case "grid":
      return (
        <>
          {(["columns", "rows"] as const).map((side) => (
            <NumberField
              key={side}
              label={texts[side]}
              value={form[side]}
              onValue={(number) => set({ [side]: number })}
              min={1}
              max={100}
              step={1}
              placeholder="6"
            />
          ))}
          {height}
          <SelectField
            label={texts.look}
            value={form.gridLook}
            onValue={(gridLook) => set({ gridLook })}
            options={(["centre", "down"] as const).map((value) => ({
              value,
              title: strings.views.gridLooks[value],
            }))}
          />
        </>
      );
    case "around-current":
      return count(32);
    case "box":
    case "drawing":
      return (
        <>
          {count(100)}
          <SelectField
            label={texts.look}
            value={form.look}
            onValue={(look) => set({ look })}
            options={(["middle", "nearest"] as const).map((value) => ({
              value,
              title: strings.views.looks[value],
            }))}
          />
          <CheckField checked={form.level} onChecked={(level) => set({ level })}>
            {texts.level}
          </CheckField>
        </>
      );
    case "dataset":
      return null;
  }
}

interface ConstraintFieldsProps extends CandidatesFieldsProps {
  drawings: readonly Drawing[];
}

/** Where candidates may be. */
export function ConstraintFields({ form, onChange, drawings, unit }: ConstraintFieldsProps) {
  const zones = drawings.filter(({ use }) => use === "no-fly").length;
  return (
    <>
      <NumberField
        label={texts.safety(unit)}
        value={form.safety}
        onValue={(safety) => onChange({ ...form, safety })}
        min={0}
        placeholder={texts.automatic}
      />
      {zones > 0 && (
        <CheckField checked={form.noFly} onChecked={(noFly) => onChange({ ...form, noFly })}>
          {texts.noFly(zones)}
        </CheckField>
      )}
    </>
  );
}
