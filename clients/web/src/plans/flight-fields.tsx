import { CheckField, NumberField, SelectField } from "../components/fields";
import type { Drawing } from "../store/scene";
import { strings } from "../strings";
import type { MissionForm } from "./mission-form";

interface FlightFieldsProps {
  form: MissionForm;
  onChange: (change: Partial<MissionForm>) => void;
  drawings: readonly Drawing[];
}

const texts = strings.plans.mission;
const DATUMS = ["", "takeoff", "sea-level", "ellipsoid"] as const;

/** Heights, speeds and limits of a flight, in groups. */
export function FlightFields({ form, onChange, drawings }: FlightFieldsProps) {
  const fences = drawings.filter(({ use }) => use === "fence");
  return (
    <>
      <fieldset>
        <legend>{texts.flight}</legend>
        <div class="fields">
          <NumberField
            label={texts.battery}
            value={form.battery}
            onValue={(battery) => onChange({ battery })}
            min={1}
            placeholder={texts.batteryNone}
          />
          <NumberField
            label={texts.reserve}
            value={form.reserve}
            onValue={(reserve) => onChange({ reserve })}
            min={0}
            max={90}
          />
          <NumberField
            label={texts.speed}
            value={form.speed}
            onValue={(speed) => onChange({ speed })}
            min={0.1}
            max={50}
          />
          <NumberField
            label={texts.hold}
            value={form.hold}
            onValue={(hold) => onChange({ hold })}
            min={0}
            max={600}
          />
          <SelectField
            label={texts.finish}
            value={form.finish}
            onValue={(finish) => onChange({ finish })}
            options={(["return", "hold"] as const).map((value) => ({ value, title: texts.finishes[value] }))}
          />
        </div>
      </fieldset>
      <details>
        <summary>{texts.heights}</summary>
        <div class="fields">
          <NumberField
            label={texts.transit}
            value={form.transit}
            onValue={(transit) => onChange({ transit })}
            placeholder={texts.transitNone}
          />
          <NumberField
            label={texts.lowest}
            value={form.lowest}
            onValue={(lowest) => onChange({ lowest })}
            placeholder={texts.none}
          />
          <NumberField
            label={texts.highest}
            value={form.highest}
            onValue={(highest) => onChange({ highest })}
            placeholder={texts.none}
          />
          <SelectField
            label={texts.datum}
            value={form.datum}
            onValue={(datum) => onChange({ datum })}
            options={DATUMS.map((value) => ({ value, title: texts.datums[value] }))}
          />
          <NumberField label={texts.geoid} value={form.geoid} onValue={(geoid) => onChange({ geoid })} />
        </div>
        <CheckField checked={form.terrain} onChecked={(terrain) => onChange({ terrain })}>
          {texts.terrain}
        </CheckField>
        {form.terrain && (
          <CheckField checked={form.aboveGround} onChecked={(aboveGround) => onChange({ aboveGround })}>
            {texts.aboveGround}
          </CheckField>
        )}
      </details>
      <details>
        <summary>{texts.limits}</summary>
        <div class="fields">
          <SelectField
            label={texts.fence}
            value={form.fence}
            onValue={(fence) => onChange({ fence })}
            options={[
              { value: "", title: texts.noFence },
              ...fences.map(({ id }, index) => ({ value: id, title: texts.fenceNumber(index + 1) })),
            ]}
          />
          <NumberField
            label={texts.gimbalLowest}
            value={form.gimbalLowest}
            onValue={(gimbalLowest) => onChange({ gimbalLowest })}
            min={-90}
            max={90}
            placeholder="-90"
          />
          <NumberField
            label={texts.gimbalHighest}
            value={form.gimbalHighest}
            onValue={(gimbalHighest) => onChange({ gimbalHighest })}
            min={-90}
            max={90}
            placeholder="30"
          />
        </div>
      </details>
    </>
  );
}
