import { useEffect } from "preact/hooks";
import type { Schemas } from "../api/service";
import { formatCount, formatPercent } from "../components/format";
import { DropTarget } from "../photographs/add-files";
import { uploadsOf } from "../photographs/uploads";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";
import { CancelJob } from "../work/cancel-job";
import { JobProgress } from "../work/job-progress";
import { noticeJobs } from "./job-notices";
import "./scene-title.css";

/** The scene's name and counts, whether the page is up to date, and what the service does now. */
export function SceneTitle({ store }: SceneProps) {
  useEffect(() => noticeJobs(store), [store]);
  const connection = store.connection.value;
  const job = store.openJob.value;
  const scene = store.scene.value;
  const snapshot = store.snapshots.value[0] ?? null;
  return (
    <div class="scene-title">
      <h1 title={scene?.name}>{scene?.name ?? strings.loading}</h1>
      <span class={`connection ${connection}`} role="status">
        {strings.connection[connection]}
      </span>
      {scene && scene.image_counts.received > 0 && (
        <Counts counts={scene.image_counts} registered={snapshot?.metrics.registered ?? null} />
      )}
      <span class="grow" />
      <Sending sceneId={store.id} />
      {job && (
        <span class="job">
          <JobProgress job={job} />
          <CancelJob job={job} />
        </span>
      )}
      <DropTarget sceneId={store.id} />
    </div>
  );
}

interface CountsProps {
  counts: Schemas["ImageCounts"];
  /** In the newest model; null before there is one. */
  registered: number | null;
}

function Counts({ counts, registered }: CountsProps) {
  const texts = strings.title;
  return (
    <span class="counts small tabular">
      <span>{texts.images(counts.received, formatCount(counts.received))}</span>
      {registered !== null && <span>{texts.registered(formatCount(registered))}</span>}
      {counts.rejected > 0 && <span class="warning">{texts.rejected(formatCount(counts.rejected))}</span>}
    </span>
  );
}

/** How far the upload is, also while another panel is shown. */
function Sending({ sceneId }: { sceneId: string }) {
  const { open, bytes, sentBytes } = uploadsOf(sceneId).totals.value;
  if (open === 0) return null;
  const share = bytes > 0 ? sentBytes / bytes : 0;
  return <span class="sending small tabular">{strings.title.sending(formatPercent(share))}</span>;
}
