import { api, data } from "../api/service";
import { ConstraintFields, GeneratorFields, SourceFields } from "../candidates/candidates-fields";
import { SOURCES } from "../candidates/candidates-form";
import { NoModel, SnapshotField } from "../candidates/model-choice";
import { metric } from "../candidates/site";
import { Failure } from "../components/failure";
import { CheckField, NumberField } from "../components/fields";
import { History } from "../components/history";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";
import "../candidates/panel.css";
import { MissionSection } from "./mission-section";
import type { PlanForm } from "./plan-form";
import { PlanResult } from "./plan-result";
import { planRun } from "./plan-run";
import { VehicleFields } from "./vehicle-fields";

const texts = strings.plans;
const PLAN_SOURCES = SOURCES.filter((source) => source !== "around-current");

/** Plans of several views or vehicles, and the missions that fly them. */
export function PlansPanel({ store }: SceneProps) {
  const plan = store.plan.value;
  return (
    <div class="panel-content">
      {store.snapshot.value === null && <NoModel />}
      <PlanFormSection store={store} />
      {plan ? <PlanResult store={store} plan={plan} /> : <p class="hint">{texts.result.none}</p>}
      <MissionSection store={store} />
      <Plans store={store} />
    </div>
  );
}

function PlanFormSection({ store }: SceneProps) {
  const run = planRun(store);
  const form = run.form.value;
  const set = (change: Partial<PlanForm>) => {
    run.form.value = { ...run.form.peek(), ...change };
  };
  const unit = strings.views.unit[metric(store) ? "metres" : "units"];
  const drawings = store.drawings.value;
  const candidates = {
    form: form.candidates,
    onChange: (candidates: PlanForm["candidates"]) => set({ candidates }),
  };
  const submit = (event: Event) => {
    event.preventDefault();
    void run.start();
  };
  return (
    <form onSubmit={submit} noValidate>
      <fieldset disabled={store.cameras.value === null}>
        <legend>{texts.form.title}</legend>
        <SourceFields {...candidates} sources={PLAN_SOURCES} drawings={drawings} />
        <div class="fields">
          <NumberField
            label={texts.form.views}
            value={form.views}
            onValue={(views) => set({ views })}
            min={1}
            max={100}
            step={1}
          />
          <NumberField
            label={texts.form.distance(unit)}
            value={form.distance}
            onValue={(distance) => set({ distance })}
            min={0}
            placeholder={strings.views.form.unlimited}
          />
        </div>
        <VehicleFields store={store} vehicles={form.vehicles} onChange={(vehicles) => set({ vehicles })} />
        <CheckField checked={form.home} onChecked={(home) => set({ home })}>
          {texts.form.home}
        </CheckField>
        <details>
          <summary>{texts.form.more}</summary>
          <div class="fields">
            <GeneratorFields {...candidates} unit={unit} />
            <ConstraintFields {...candidates} drawings={drawings} unit={unit} />
            <SnapshotField store={store} />
          </div>
        </details>
        <p class="actions">
          {run.busy.value && <span role="status">{texts.form.busy}</span>}
          <button type="submit" class="primary" disabled={run.busy.value}>
            {texts.form.plan}
          </button>
        </p>
      </fieldset>
      <Failure error={run.failure.value} onRetry={() => void run.again()} />
    </form>
  );
}

function Plans({ store }: SceneProps) {
  const path = (plan_id: string) => ({ params: { path: { plan_id } } });
  const show = async (id: string) => {
    store.plan.value = await data(api.GET("/v1/plans/{plan_id}", path(id)));
  };
  const remove = async (id: string) => {
    await api.DELETE("/v1/plans/{plan_id}", path(id));
    if (store.plan.value?.id === id) store.plan.value = null;
  };
  const items = store.plans.value.map(({ id, summary, created_at }) => ({
    id,
    title: summary,
    details: "",
    created_at,
  }));
  return (
    <History
      title={strings.views.history.plans}
      items={items}
      shown={store.plan.value?.id ?? null}
      onShow={show}
      onDelete={remove}
    />
  );
}
