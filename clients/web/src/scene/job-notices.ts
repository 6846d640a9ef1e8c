import { effect } from "@preact/signals";
import type { Schemas } from "../api/service";
import { notify } from "../store/notices";
import type { SceneStore } from "../store/scene";
import { strings } from "../strings";
import { isOpen } from "../work/job-progress";

/** The jobs that were open and have ended since. */
export function ended(
  before: ReadonlyMap<string, Schemas["JobState"]>,
  jobs: readonly Schemas["Job"][],
): readonly Schemas["Job"][] {
  return jobs.filter((job) => {
    const state = before.get(job.id);
    return state !== undefined && isOpen({ state }) && !isOpen(job);
  });
}

/** Tell of jobs that end while the page is open; returns what ends that. */
export function noticeJobs(store: SceneStore): () => void {
  let before = new Map<string, Schemas["JobState"]>();
  return effect(() => {
    const jobs = store.jobs.value;
    for (const job of ended(before, jobs)) tell(job, store.scene.peek()?.name ?? "");
    before = new Map(jobs.map((job) => [job.id, job.state]));
  });
}

function tell(job: Schemas["Job"], scene: string): void {
  const kind = strings.work.kinds[job.kind];
  if (job.state === "succeeded") notify("success", strings.title.succeeded(kind, scene));
  if (job.state === "failed" && job.error) {
    notify("error", strings.title.failed(kind, scene, job.error.message), job.error.hint);
  }
}
