import { useRef, useState } from "preact/hooks";
import type { Schemas } from "../api/service";
import { formatAge, formatBytes, formatCount, formatDate, formatDecibels } from "../components/format";
import { useVisible } from "../components/use-visible";
import { hrefOf } from "../router";
import { strings } from "../strings";
import { JobProgress } from "../work/job-progress";
import { DeleteScene, RenameScene } from "./change-scene";
import { type SceneDetails, useDetails } from "./scene-details";

const texts = strings.scenes;

interface SceneRowProps {
  scene: Schemas["Scene"];
  /** Changes when details are to be loaded again. */
  version: number;
  onChange: () => void;
}

/** A scene as a row of the list. */
export function SceneRow({ scene, version, onChange }: SceneRowProps) {
  const row = useRef<HTMLTableRowElement>(null);
  const details = useDetails(scene, useVisible(row), version);
  const [open, setOpen] = useState<"rename" | "delete" | null>(null);
  const close = () => setOpen(null);
  return (
    <tr ref={row}>
      <th scope="row">
        <a
          class="scene-name"
          href={hrefOf({ page: "scene", sceneId: scene.id, stage: "view3d", panel: "photographs" })}
        >
          {scene.name}
        </a>
        <span class="muted small">{texts.created(formatDate(scene.created_at))}</span>
      </th>
      <td>
        <State scene={scene} job={details.job} />
      </td>
      <td>
        <Photographs scene={scene} snapshot={details.snapshot} />
      </td>
      <td>
        <Model scene={scene} snapshot={details.snapshot} />
      </td>
      <td class="number">{sizeOf(details)}</td>
      <td class="row-actions">
        <button
          type="button"
          class="quiet"
          aria-label={texts.renameOf(scene.name)}
          onClick={() => setOpen("rename")}
        >
          {texts.rename}
        </button>
        <button
          type="button"
          class="quiet danger"
          aria-label={texts.deleteOf(scene.name)}
          onClick={() => setOpen("delete")}
        >
          {texts.delete}
        </button>
        {open === "rename" && <RenameScene scene={scene} onDone={onChange} onClose={close} />}
        {open === "delete" && (
          <DeleteScene scene={scene} details={details} onDone={onChange} onClose={close} />
        )}
      </td>
    </tr>
  );
}

function sizeOf(details: SceneDetails): string {
  return details.size ? formatBytes(details.size.total_bytes) : strings.components.unknown;
}

function State({ scene, job }: { scene: Schemas["Scene"]; job: Schemas["Job"] | null }) {
  if (job) return <JobProgress job={job} />;
  if (scene.image_counts.received === 0) return <span class="muted">{texts.noImages}</span>;
  const { pending } = scene.image_counts;
  if (pending > 0) return <span class="warning">{texts.waitingImages(formatCount(pending))}</span>;
  return <span>{texts.idle}</span>;
}

interface OfScene {
  scene: Schemas["Scene"];
  snapshot: Schemas["Snapshot"] | null;
}

function Photographs({ scene, snapshot }: OfScene) {
  const counts = scene.image_counts;
  if (counts.received === 0) return <span class="muted">{strings.components.unknown}</span>;
  return (
    <>
      <div>{texts.accepted(formatCount(counts.accepted), formatCount(counts.received))}</div>
      <div class="small muted">
        {snapshot && texts.registered(formatCount(snapshot.metrics.registered))}{" "}
        {counts.rejected > 0 && (
          <span class="badge warning">{texts.rejected(formatCount(counts.rejected))}</span>
        )}
      </div>
    </>
  );
}

function Model({ scene, snapshot }: OfScene) {
  if (scene.snapshot_id === null) return <span class="muted">{texts.noModel}</span>;
  if (!snapshot) return <span class="muted">{strings.components.unknown}</span>;
  const { gaussians, new_images_psnr_db } = snapshot.metrics;
  return (
    <>
      <div title={formatDate(snapshot.created_at)}>{formatAge(snapshot.created_at)}</div>
      <div class="small muted">{texts.gaussians(formatCount(gaussians))}</div>
      {new_images_psnr_db !== null && (
        <div class="small muted" title={texts.psnrTitle}>
          {texts.psnr(formatDecibels(new_images_psnr_db))}
        </div>
      )}
    </>
  );
}
