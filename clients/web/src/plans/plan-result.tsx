import type { Schemas } from "../api/service";
import { shareCandidate } from "../candidates/same-view";
import { metric } from "../candidates/site";
import { formatLength, formatShare } from "../components/format";
import { WarningsList } from "../components/warnings-list";
import type { SceneStore } from "../store/scene";
import { strings } from "../strings";

const texts = strings.plans.result;

interface PlanProps {
  store: SceneStore;
  plan: Schemas["Plan"];
}

/** A plan: what it brings, the stops of each vehicle, and why these. */
export function PlanResult({ store, plan }: PlanProps) {
  return (
    <section aria-label={texts.title}>
      <header class="shown">
        <h2 class="grow">{texts.title}</h2>
        <button
          type="button"
          class="quiet"
          onClick={() => {
            store.plan.value = null;
          }}
        >
          {texts.hide}
        </button>
      </header>
      <p>{plan.summary}</p>
      <dl>
        <dt>{texts.now}</dt>
        <dd>{formatExpectation(plan.now)}</dd>
        <dt>{texts.end}</dt>
        <dd>{formatExpectation(plan.end)}</dd>
      </dl>
      {plan.now.psnr_db === null && <p class="hint">{texts.uncalibrated}</p>}
      {plan.photographed.length > 0 && <p class="hint">{texts.photographed(plan.photographed.length)}</p>}
      <WarningsList warnings={plan.warnings} />
      {plan.tours.map((tour) => (
        <TourTable key={tour.vehicle} store={store} tour={tour} />
      ))}
      <TermsTable plan={plan} store={store} />
    </section>
  );
}

/** What to expect of a model: its PSNR with an interval, or the variance before there is a calibration. */
export function formatExpectation({ variance, psnr_db, low_db, high_db }: Schemas["Expectation"]): string {
  if (psnr_db === null || low_db === null || high_db === null) return texts.variance(variance.toFixed(3));
  return texts.decibels(psnr_db.toFixed(1), low_db.toFixed(1), high_db.toFixed(1));
}

function TourTable({ store, tour }: { store: SceneStore; tour: Schemas["Tour"] }) {
  const inMetres = metric(store);
  if (tour.stops.length === 0) return <p class="hint">{texts.idle(tour.vehicle)}</p>;
  const selection = store.selection.value;
  return (
    <div class="scrolled">
      <table>
        <caption>
          {texts.tour(tour.vehicle, tour.stops.length, formatLength(tour.length_m, inMetres))}
        </caption>
        <thead>
          <tr>
            <th class="number">{texts.columns.number}</th>
            <th>{texts.columns.stop}</th>
            <th class="number">{texts.columns.leg}</th>
            <th class="number">{texts.columns.travel}</th>
            <th>{texts.columns.after}</th>
          </tr>
        </thead>
        <tbody>
          {tour.stops.map((stop, index) => (
            <tr key={stop.id} aria-selected={selection?.kind === "stop" && selection.id === stop.id}>
              <td class="number">{index + 1}</td>
              <td>
                <button
                  type="button"
                  class="link"
                  onClick={() => {
                    store.selection.value = { kind: "stop", id: stop.id };
                  }}
                >
                  {stop.id}
                </button>
              </td>
              <td class="number">{formatLength(stop.distance_m, inMetres)}</td>
              <td class="number">{formatLength(stop.travel_m, inMetres)}</td>
              <td>{formatExpectation(stop.after)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

function TermsTable({ store, plan }: PlanProps) {
  return (
    <details>
      <summary>{texts.terms}</summary>
      <div class="scrolled">
        <table>
          <thead>
            <tr>
              <th>{texts.termColumns.id}</th>
              <th>{texts.termColumns.planned}</th>
              <th class="number">{texts.termColumns.gain}</th>
              <th class="number">{texts.termColumns.inPlan}</th>
              <th class="number">{texts.termColumns.variance}</th>
              <th class="number">{texts.termColumns.chance}</th>
            </tr>
          </thead>
          <tbody>
            {plan.candidates.map((terms) => (
              <tr key={terms.id}>
                <td>
                  {terms.planned || shareCandidate(terms.id, store.ranking.value, plan) ? (
                    <button
                      type="button"
                      class="link"
                      onClick={() => {
                        store.selection.value = { kind: terms.planned ? "stop" : "candidate", id: terms.id };
                      }}
                    >
                      {terms.id}
                    </button>
                  ) : (
                    terms.id
                  )}
                </td>
                <td>{terms.planned ? texts.yes : texts.no}</td>
                <td class="number">{terms.gain.toFixed(4)}</td>
                <td class="number">{terms.gain_in_plan.toFixed(4)}</td>
                <td class="number">{terms.variance.toFixed(3)}</td>
                <td class="number">{formatShare(terms.chance)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </details>
  );
}
