import type { Schemas } from "../api/service";
import { formatDuration, formatPercent } from "../components/format";
import { strings } from "../strings";

/** Whether a job runs or waits. */
export function isOpen(job: Pick<Schemas["Job"], "state">): boolean {
  return job.state === "running" || job.state === "queued";
}

/** How long a job took from its start to its end, in s; null when it never ran or has not ended. */
export function tookS(job: Pick<Schemas["Job"], "started_at" | "finished_at">): number | null {
  if (job.started_at === null || job.finished_at === null) return null;
  return (Date.parse(job.finished_at) - Date.parse(job.started_at)) / 1000;
}

/** What an open job does now, in words: its stage, or why it waits. */
export function doing(job: Schemas["Job"]): string {
  if (job.cancel_requested) return strings.work.canceling;
  if (job.state === "queued") {
    const { waiting } = job;
    if (!waiting) return strings.work.states.queued;
    const isNext = waiting.reason === "queue" && waiting.place === 1;
    return isNext ? strings.work.isNext : strings.work.waiting[waiting.reason];
  }
  return job.stage ? strings.work.stages[job.stage] : strings.work.states.running;
}

/** When an open job ends or starts, as far as the service knows; empty when it does not. */
export function remaining(job: Schemas["Job"]): string {
  if (job.state === "queued") {
    const eta = job.waiting?.eta_s ?? null;
    return eta === null || eta < 1 ? "" : strings.work.startsIn(formatDuration(eta));
  }
  return job.eta_s === null ? "" : strings.work.left(formatDuration(job.eta_s));
}

/** An open job in one line: kind, stage, a bar, percent and the time left. */
export function JobProgress({ job }: { job: Schemas["Job"] }) {
  const kind = strings.work.kinds[job.kind];
  return (
    <span class="job-progress">
      <span class="what">
        <strong>{kind}</strong> {doing(job)}
      </span>
      {job.state === "running" && (
        <>
          <progress value={job.progress} max={1} aria-label={kind} />
          <span class="tabular">{formatPercent(job.progress)}</span>
        </>
      )}
      <span class="muted left">{remaining(job)}</span>
    </span>
  );
}
