import type { Schemas } from "../api/service";

/** Whether a job runs or waits. */
export function isOpen(job: Schemas["Job"]): boolean {
  return job.state === "running" || job.state === "queued";
}

/** How long a job took from its start to its end, in s; null when it never ran or has not ended. */
export function tookS(job: Pick<Schemas["Job"], "started_at" | "finished_at">): number | null {
  if (job.started_at === null || job.finished_at === null) return null;
  return (Date.parse(job.finished_at) - Date.parse(job.started_at)) / 1000;
}
