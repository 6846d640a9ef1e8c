import { metric } from "../candidates/site";
import { saveAs } from "../components/download";
import { Failure } from "../components/failure";
import { CheckField, NumberField, SelectField } from "../components/fields";
import { formatDuration, formatLength } from "../components/format";
import { capabilities } from "../store/capabilities";
import { report } from "../store/notices";
import type { SceneProps, SceneStore } from "../store/scene";
import { strings } from "../strings";
import { FlightFields } from "./flight-fields";
import { HomeFields } from "./home-fields";
import { allLeftOut, briefingOf, flying, type MissionPart } from "./mission-files";
import {
  isFlown,
  isMavlink,
  MISSION,
  MISSION_SOURCES,
  type MissionForm,
  type MissionFormat,
  objection,
} from "./mission-form";
import { missionState } from "./mission-state";

const texts = strings.plans.mission;

/** Writes files for autopilots and ground stations from the shown ranking or plan, or the photographs. */
export function MissionSection({ store }: SceneProps) {
  const state = missionState(store);
  const form = state.usable();
  const set = (change: Partial<MissionForm>) => {
    state.form.value = { ...state.form.peek(), ...change };
  };
  const submit = (event: Event) => {
    event.preventDefault();
    void state.prepare();
  };
  const flown = isFlown(form.format);
  return (
    <section aria-label={texts.title}>
      <h2>{texts.title}</h2>
      <form onSubmit={submit} noValidate>
        <fieldset disabled={store.snapshot.value === null}>
          <SourceFields store={store} form={form} onChange={set} />
          <FormatFields store={store} form={form} onChange={set} />
          {flown && <HomeFields store={store} form={form} onChange={set} />}
          {flown && <FlightFields form={form} onChange={set} drawings={store.drawings.value} />}
          <CheckField checked={form.leaveOut} onChecked={(leaveOut) => set({ leaveOut })}>
            {texts.leaveOut}
          </CheckField>
          <p class="actions">
            {state.busy.value && <span role="status">{texts.preparing}</span>}
            <button type="submit" class="primary" disabled={state.busy.value}>
              {texts.prepare}
            </button>
          </p>
        </fieldset>
        <Failure error={state.failure.value} onRetry={() => void state.prepare()} />
      </form>
      <Files store={store} />
    </section>
  );
}

interface FieldsProps {
  store: SceneStore;
  form: MissionForm;
  onChange: (change: Partial<MissionForm>) => void;
}

function SourceFields({ store, form, onChange }: FieldsProps) {
  const ready = { ranking: store.ranking.value !== null, plan: store.plan.value !== null, photographs: true };
  const vehicles = flying(store.plan.value);
  return (
    <div class="fields">
      <SelectField
        label={texts.what}
        value={form.source}
        onValue={(source) => onChange({ source })}
        options={MISSION_SOURCES.map((value) => ({
          value,
          title: texts.sources[value],
          disabled: !ready[value],
        }))}
      />
      {form.source === "ranking" && (
        <NumberField
          label={texts.first}
          value={form.first}
          onValue={(first) => onChange({ first })}
          min={1}
          step={1}
        />
      )}
      {form.source === "plan" && vehicles.length > 1 && (
        <SelectField
          label={texts.vehicle}
          value={vehicles.includes(form.vehicle) ? form.vehicle : ""}
          onValue={(vehicle) => onChange({ vehicle })}
          options={[
            { value: "", title: texts.allVehicles },
            ...vehicles.map((value) => ({ value, title: texts.vehicleNumber(value) })),
          ]}
        />
      )}
    </div>
  );
}

function FormatFields({ store, form, onChange }: FieldsProps) {
  const georeferenced = store.frames.value?.georeferenced ?? false;
  const formats = (capabilities.value?.mission_formats ?? [MISSION.format]) as MissionFormat[];
  const options = formats.map((value) => {
    const reason = objection(value, georeferenced, metric(store));
    const title = texts.formats[value];
    return { value, title: reason ? texts.unavailable(title, reason) : title, disabled: reason !== null };
  });
  return (
    <div class="fields">
      <SelectField
        label={texts.format}
        value={form.format}
        onValue={(format) => onChange({ format })}
        options={options}
      />
      {isMavlink(form.format) && (
        <SelectField
          label={texts.autopilot}
          value={form.autopilot}
          onValue={(autopilot) => onChange({ autopilot })}
          options={(["ardupilot", "px4"] as const).map((value) => ({
            value,
            title: texts.autopilots[value],
          }))}
        />
      )}
      {form.format === "dji-kmz" && (
        <SelectField
          label={texts.drone}
          value={form.drone}
          onValue={(drone) => onChange({ drone })}
          options={(Object.keys(texts.drones) as MissionForm["drone"][]).map((value) => ({
            value,
            title: texts.drones[value],
          }))}
        />
      )}
    </div>
  );
}

function Files({ store }: SceneProps) {
  const state = missionState(store);
  const prepared = state.prepared.value;
  if (!prepared) return null;
  if (prepared.key !== state.key()) return <p class="warning">{texts.changed}</p>;
  const { parts } = prepared;
  const total = (of: (part: MissionPart) => number) => parts.reduce((sum, part) => sum + of(part), 0);
  const length = total((part) => part.route?.length_m ?? 0);
  const leftOut = allLeftOut(parts);
  return (
    <div role="status" class="files">
      {parts[0]?.route && (
        <p>
          {texts.ready(
            parts.length,
            total((part) => part.route?.views ?? 0),
          )}{" "}
          {texts.flown(
            formatLength(length, true),
            formatDuration(total((part) => part.route?.duration_s ?? 0)),
            parts.length,
          )}
        </p>
      )}
      <ol>
        {parts.map((part) => (
          <li key={part.name}>
            <span class="grow">
              <span class="name">{part.name}</span>
              {part.route && (
                <span class="hint">
                  {texts.part(
                    part.route.views,
                    formatLength(part.route.length_m, true),
                    formatDuration(part.route.duration_s),
                  )}
                </span>
              )}
            </span>
            {part.briefing && (
              <button type="button" onClick={() => void brief(part).catch(report)}>
                {texts.briefing}
              </button>
            )}
            <button type="button" onClick={() => saveAs(part.content, part.name)}>
              {texts.download}
            </button>
          </li>
        ))}
      </ol>
      {parts.length > 1 && (
        <button type="button" onClick={() => void saveAll(parts)}>
          {texts.downloadAll}
        </button>
      )}
      {leftOut.length > 0 && (
        <>
          <p class="warning">{texts.leftOut(leftOut.length)}</p>
          <ul>
            {leftOut.map(({ id, reason }) => (
              <li key={id}>{texts.reason(store.imageByDigest.value.get(id)?.name ?? id, reason)}</li>
            ))}
          </ul>
        </>
      )}
    </div>
  );
}

async function brief({ briefing, name }: MissionPart): Promise<void> {
  if (!briefing) return;
  const picture = await briefingOf(briefing, name);
  saveAs(picture.content, picture.name);
}

/** Save all files, one after the other: browsers drop downloads that begin at once. */
async function saveAll(parts: readonly MissionPart[]): Promise<void> {
  for (const part of parts) {
    saveAs(part.content, part.name);
    await new Promise((resolve) => setTimeout(resolve, 300));
  }
}
