import { api, data, type Schemas } from "../api/service";
import { Failure } from "../components/failure";
import { CheckField } from "../components/fields";
import { History } from "../components/history";
import { WarningsList } from "../components/warnings-list";
import type { SceneProps, SceneStore } from "../store/scene";
import { strings } from "../strings";
import "../candidates/panel.css";
import "./views.css";
import { NoModel } from "../candidates/model-choice";
import { numberOf } from "../candidates/values";
import { ContactSheet } from "./contact-sheet";
import { ForecastSection } from "./forecast-section";
import { RankingFields } from "./ranking-fields";
import { rankingRun } from "./ranking-run";
import { RankingTable } from "./ranking-table";

const texts = strings.views;

/** Which views are next: the form of a ranking, the shown one with its pictures, and what the model does not know. */
export function ViewsPanel({ store }: SceneProps) {
  const ranking = store.ranking.value;
  return (
    <div class="panel-content">
      {store.snapshot.value === null && <NoModel />}
      <RankingForm store={store} />
      {ranking ? <Shown store={store} ranking={ranking} /> : <p class="hint">{texts.table.none}</p>}
      <ForecastSection store={store} />
      <Rankings store={store} />
    </div>
  );
}

function RankingForm({ store }: SceneProps) {
  const run = rankingRun(store);
  const progress = run.progress.value;
  const submit = (event: Event) => {
    event.preventDefault();
    void run.start();
  };
  return (
    <form onSubmit={submit} noValidate>
      <fieldset disabled={store.cameras.value === null}>
        <legend>{texts.form.title}</legend>
        <RankingFields store={store} />
        <CheckField
          checked={run.keepUpToDate.value}
          onChecked={(checked) => {
            run.keepUpToDate.value = checked;
          }}
        >
          {texts.form.keepUpToDate}
        </CheckField>
        <p class="actions">
          {progress && (
            <>
              <progress
                {...(progress.expected !== null && { value: progress.scored, max: progress.expected })}
                aria-label={texts.form.rank}
              />
              <span role="status">{texts.form.scored(progress.scored, progress.expected)}</span>
              <button type="button" onClick={() => run.cancel()}>
                {texts.form.cancel}
              </button>
            </>
          )}
          <button type="submit" class="primary" disabled={progress !== null}>
            {texts.form.rank}
          </button>
        </p>
      </fieldset>
      <Failure error={run.failure.value} onRetry={() => void run.start()} />
    </form>
  );
}

function Shown({ store, ranking }: { store: SceneStore; ranking: Schemas["Ranking"] }) {
  const k = numberOf(rankingRun(store).form.value.k) ?? 0;
  const { method } = ranking.request;
  return (
    <section aria-label={texts.table.title}>
      <header class="shown">
        <h2 class="grow">{texts.table.title}</h2>
        <button
          type="button"
          class="quiet"
          onClick={() => {
            store.ranking.value = null;
          }}
        >
          {texts.table.hide}
        </button>
      </header>
      <p>
        {texts.table.of(texts.methods[method].title, ranking.total, ranking.seconds.toFixed(1))}{" "}
        <span class="hint">
          {ranking.fallback
            ? texts.table.fallback(ranking.fallback)
            : texts.table.scoreIs(texts.scores[method])}
        </span>
      </p>
      <WarningsList warnings={ranking.warnings} />
      <RankingTable store={store} candidates={ranking.candidates} />
      <h3>
        {texts.sheet.title} {k}
      </h3>
      <ContactSheet store={store} ranking={ranking} k={k} />
    </section>
  );
}

function Rankings({ store }: SceneProps) {
  const path = (ranking_id: string) => ({ params: { path: { ranking_id } } });
  const show = async (id: string) => {
    store.ranking.value = await data(api.GET("/v1/rankings/{ranking_id}", path(id)));
  };
  const remove = async (id: string) => {
    await api.DELETE("/v1/rankings/{ranking_id}", path(id));
    if (store.ranking.value?.id === id) store.ranking.value = null;
  };
  const items = store.rankings.value.map((one) => ({
    id: one.id,
    title: texts.history.ranking(methodTitle(one.method), one.total),
    details: one.best === null ? "" : texts.history.best(one.best),
    created_at: one.created_at,
  }));
  return (
    <History
      title={texts.history.rankings}
      items={items}
      shown={store.ranking.value?.id ?? null}
      onShow={show}
      onDelete={remove}
    />
  );
}

function methodTitle(method: string): string {
  return (texts.methods as Record<string, { title: string }>)[method]?.title ?? method;
}
