import { useState } from "preact/hooks";
import { picturePath } from "../api/paths";
import { api, data, type Schemas } from "../api/service";
import { shareCandidate, visitsOf } from "../candidates/same-view";
import { metric } from "../candidates/site";
import { formatLength, formatPose, formatScore, formatShare } from "../components/format";
import { ServiceImage } from "../components/service-image";
import { planRun } from "../plans/plan-run";
import { show } from "../router";
import { notify, report } from "../store/notices";
import type { SceneStore } from "../store/scene";
import { strings } from "../strings";

const texts = strings.views.card;
const VEHICLE = "fvs-vehicle";

interface CandidateCardProps {
  store: SceneStore;
  /** The id of a candidate of the shown ranking, or of a stop or candidate of the shown plan. */
  id: string;
}

/** What is known of a candidate, why it has its place, and what can be done with it. */
export function CandidateCard({ store, id }: CandidateCardProps) {
  const ranking = store.ranking.value;
  const plan = store.plan.value;
  const stopFirst = store.selection.value?.kind === "stop";
  const ranked = stopFirst ? undefined : ranking?.candidates.find((one) => one.id === id);
  const stop = ranked ? undefined : plan?.tours.flatMap((tour) => tour.stops).find((one) => one.id === id);
  const pose = ranked?.pose ?? stop?.pose;
  const planned = stop !== undefined || shareCandidate(id, ranking, plan);
  const terms = planned ? plan?.candidates.find((one) => one.id === id) : undefined;
  if (!pose) return <p class="hint">{texts.gone}</p>;
  const visits = visitsOf(store, id, pose);
  return (
    <div class="candidate-card">
      {ranking && ranked && <RankedFacts store={store} ranking={ranking} candidate={ranked} />}
      <PoseFacts pose={pose} />
      {terms && <Terms store={store} terms={terms} />}
      {visits.map((visit) => (
        <p key={visit.vehicle} class="warning">
          {texts.visit(visit.vehicle, texts.visits[visit.state])}
        </p>
      ))}
      <Deeds store={store} id={id} pose={pose} ranking={ranked ? ranking : null} />
    </div>
  );
}

function RankedFacts({
  store,
  ranking,
  candidate,
}: {
  store: SceneStore;
  ranking: Schemas["Ranking"];
  candidate: Schemas["RankedCandidate"];
}) {
  const { id, rank, score, coverage, chance, status, distance_m } = candidate;
  const sheet = strings.views.sheet;
  const exists = store.snapshots.value.some((one) => one.id === ranking.snapshot_id);
  return (
    <>
      {exists ? (
        <div class="pair">
          <ServiceImage path={picturePath(ranking.id, id, "render")} alt={sheet.render(id)} />
          <ServiceImage path={picturePath(ranking.id, id, "spectrum")} alt={sheet.spectrum(id)} />
        </div>
      ) : (
        <p class="hint">{sheet.snapshotGone}</p>
      )}
      <p>
        <strong>{rank === null ? texts.noRank : texts.rank(rank, ranking.total)}</strong>{" "}
        <span class={status === "ranked" ? "hint" : "warning"}>{strings.views.whys[status]}</span>
      </p>
      <dl>
        <dt title={strings.views.scores[ranking.request.method]}>{texts.score}</dt>
        <dd>{formatScore(score)}</dd>
        <dt>{texts.coverage}</dt>
        <dd>{formatShare(coverage)}</dd>
        <dt>{texts.chance}</dt>
        <dd>{formatShare(chance)}</dd>
        <dt>{texts.distance}</dt>
        <dd>{formatLength(distance_m, metric(store))}</dd>
      </dl>
    </>
  );
}

function PoseFacts({ pose }: { pose: Schemas["RankedCandidate"]["pose"] }) {
  const copy = async () => {
    await navigator.clipboard.writeText(JSON.stringify(pose));
    notify("success", texts.copied);
  };
  return (
    <>
      <p class="pose">
        {formatPose(pose).map((line) => (
          <span key={line}>{line}</span>
        ))}
      </p>
      <button type="button" class="quiet copy" onClick={() => void copy().catch(report)}>
        {texts.copy}
      </button>
    </>
  );
}

function Terms({ store, terms }: { store: SceneStore; terms: Schemas["CandidateTerms"] }) {
  const names = terms.helps.map((id) => store.imageByDigest.value.get(id)?.name ?? id);
  return (
    <details open>
      <summary>{texts.terms}</summary>
      <p>{terms.planned ? texts.planned : texts.notPlanned}</p>
      <dl>
        <dt>{texts.gain}</dt>
        <dd>{terms.gain.toFixed(4)}</dd>
        <dt>{texts.gainInPlan}</dt>
        <dd>{terms.gain_in_plan.toFixed(4)}</dd>
        <dt>{texts.variance}</dt>
        <dd>{terms.variance.toFixed(3)}</dd>
        <dt>{texts.way}</dt>
        <dd>{formatLength(terms.distance_m, metric(store))}</dd>
        <dt>{texts.chance}</dt>
        <dd>{formatShare(terms.chance)}</dd>
      </dl>
      {names.length > 0 && (
        <p>
          {texts.helps}: {names.join(", ")}
        </p>
      )}
    </details>
  );
}

interface DeedsProps {
  store: SceneStore;
  id: string;
  pose: Schemas["RankedCandidate"]["pose"];
  /** The ranking that the candidate is of. */
  ranking: Schemas["Ranking"] | null;
}

function Deeds({ store, id, pose, ranking }: DeedsProps) {
  const [vehicle, setVehicle] = useState(sessionStorage.getItem(VEHICLE) ?? "vehicle-1");
  const camera = store.frames.value?.cameraInModel(pose) ?? null;
  const report_ = async (state: Schemas["VisitState"]) => {
    sessionStorage.setItem(VEHICLE, vehicle);
    const body = { vehicle, state, views: [{ id, pose }] };
    const options = { params: { path: { scene_id: store.id } }, body };
    store.visits.value = (await data(api.POST("/v1/scenes/{scene_id}/visits", options))).visits;
    notify("success", texts.reported(vehicle));
  };
  const plan = () => {
    if (!ranking) return;
    const ranked = ranking.candidates.filter(({ rank }) => rank !== null);
    void planRun(store).startFrom({ candidates: ranked.map(({ id, pose }) => ({ id, pose })) });
    show({ panel: "plans" });
  };
  return (
    <>
      <p class="actions">
        <button
          type="button"
          disabled={camera === null}
          onClick={() => {
            store.lookThrough.value = camera;
          }}
        >
          {texts.lookThrough}
        </button>
        {ranking && (
          <button type="button" onClick={plan}>
            {texts.plan}
          </button>
        )}
      </p>
      <details>
        <summary>{texts.report}</summary>
        <label>
          {texts.vehicle}
          <input value={vehicle} onInput={(event) => setVehicle(event.currentTarget.value)} />
        </label>
        <p class="actions">
          {(["going-to", "taken", "failed"] as const).map((state) => (
            <button key={state} type="button" onClick={() => void report_(state).catch(report)}>
              {state === "going-to" ? texts.goingTo : texts[state]}
            </button>
          ))}
        </p>
      </details>
    </>
  );
}
