import { useState } from "preact/hooks";
import { api, type Schemas } from "../api/service";
import { formatAge, formatDate, formatDuration } from "../components/format";
import { report } from "../store/notices";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";
import { CancelJob } from "./cancel-job";
import { isOpen, JobProgress, tookS } from "./job-progress";
import { Remarks } from "./remarks";

const texts = strings.work;
const TONES: Partial<Record<Schemas["JobState"], string>> = { succeeded: "good", failed: "error" };

/** A job: how far it is or how it ended, what to do about that, and the remarks on its result. */
export function JobCard({ job, store }: SceneProps & { job: Schemas["Job"] }) {
  return (
    <article class="job-card" aria-label={texts.kinds[job.kind]}>
      {isOpen(job) ? (
        <div class="head">
          <JobProgress job={job} />
          <CancelJob job={job} />
        </div>
      ) : (
        <Ended job={job} />
      )}
      {job.state === "queued" && job.waiting && job.waiting.place > 1 && (
        <p class="small muted">{texts.place(job.waiting.place)}</p>
      )}
      {job.error && (
        <p class="small">
          <span class="error">{job.error.message}</span> <span class="hint">{job.error.hint}</span>
        </p>
      )}
      <Remarks remarks={job.warnings} store={store} />
    </article>
  );
}

function Ended({ job }: { job: Schemas["Job"] }) {
  const [busy, setBusy] = useState(false);
  const retry = async () => {
    setBusy(true);
    await api.POST("/v1/jobs/{job_id}:retry", { params: { path: { job_id: job.id } } }).catch(report);
    setBusy(false);
  };
  const kind = texts.kinds[job.kind];
  const at = job.finished_at ?? job.created_at;
  const seconds = tookS(job);
  return (
    <div class="head">
      <span class="grow">
        <strong>{kind}</strong>{" "}
        <span class={`badge ${TONES[job.state] ?? "muted"}`}>{texts.states[job.state]}</span>
        <span class="small muted ended" title={formatDate(at)}>
          {[
            formatAge(at),
            ...(seconds === null ? [] : [texts.took(formatDuration(seconds))]),
            ...(job.attempt > 1 ? [texts.attempt(job.attempt)] : []),
          ].join(" · ")}
        </span>
      </span>
      {(job.state === "canceled" || job.state === "failed") && (
        <button type="button" aria-label={texts.retryOf(kind)} disabled={busy} onClick={retry}>
          {texts.retry}
        </button>
      )}
    </div>
  );
}
