import { useState } from "preact/hooks";
import { artifactPath } from "../api/paths";
import { api, type Schemas } from "../api/service";
import { ConfirmDialog } from "../components/confirm-dialog";
import { download } from "../components/download";
import { formatAge, formatBytes, formatCount, formatDate, formatDecibels } from "../components/format";
import { report } from "../store/notices";
import type { SceneProps, SceneStore } from "../store/scene";
import { strings } from "../strings";
import { isPreview } from "./growth-series";

const texts = strings.work.snapshots;

/** How many models are listed until more are asked for: a scene has one or two of every update. */
const LISTED = 10;

/** The models that the scene has, the newest first: to show, keep, delete and download. */
export function Snapshots({ store }: SceneProps) {
  const [listed, setListed] = useState(LISTED);
  const snapshots = store.snapshots.value;
  return (
    <section>
      <div class="head">
        <h2 class="grow">{texts.title}</h2>
        {store.chosenSnapshot.value !== null && (
          <button
            type="button"
            onClick={() => {
              store.chosenSnapshot.value = null;
            }}
          >
            {texts.showNewest}
          </button>
        )}
      </div>
      {snapshots.length === 0 && <p class="muted">{texts.none}</p>}
      {snapshots.slice(0, listed).map((one, index) => (
        <SnapshotCard
          key={one.id}
          snapshot={one}
          store={store}
          newest={index === 0}
          preview={isPreview(one, snapshots)}
        />
      ))}
      {snapshots.length > listed && (
        <button type="button" onClick={() => setListed(snapshots.length)}>
          {texts.showAll(snapshots.length)}
        </button>
      )}
    </section>
  );
}

interface CardProps {
  snapshot: Schemas["Snapshot"];
  store: SceneStore;
  newest: boolean;
  preview: boolean;
}

function SnapshotCard({ snapshot, store, newest, preview }: CardProps) {
  const [deleting, setDeleting] = useState(false);
  const when = formatDate(snapshot.created_at);
  const shown = store.snapshot.value?.id === snapshot.id;
  const current = store.scene.value?.snapshot_id === snapshot.id;
  const params = { path: { snapshot_id: snapshot.id } };
  const pin = () => {
    const body = { pinned: !snapshot.pinned };
    api
      .PATCH("/v1/snapshots/{snapshot_id}", { params, body })
      .then(() => store.load())
      .catch(report);
  };
  return (
    <article class="snapshot-card" aria-label={when}>
      <div class="head">
        <span class="grow" title={when}>
          <strong>{preview ? texts.preview : strings.work.kinds[snapshot.kind]}</strong>{" "}
          {formatAge(snapshot.created_at)} {newest && <span class="badge muted">{texts.newest}</span>}{" "}
          {shown && <span class="badge good">{texts.shown}</span>}{" "}
          {snapshot.pinned && <span class="badge">{texts.pinned}</span>}
        </span>
        {!shown && (
          <button
            type="button"
            aria-label={texts.showOf(when)}
            onClick={() => {
              store.chosenSnapshot.value = newest ? null : snapshot.id;
            }}
          >
            {texts.show}
          </button>
        )}
      </div>
      <p class="small muted">{factsOf(snapshot.metrics).join(" · ")}</p>
      <details>
        <summary class="small">{texts.files}</summary>
        <ul class="artifacts">
          {snapshot.artifacts.map((artifact) => (
            <ArtifactLine key={artifact.name} artifact={artifact} snapshotId={snapshot.id} />
          ))}
        </ul>
        <p class="actions">
          <button type="button" title={texts.pinTitle} aria-pressed={snapshot.pinned} onClick={pin}>
            {snapshot.pinned ? texts.unpin : texts.pin}
          </button>
          <button
            type="button"
            class="danger"
            disabled={current || snapshot.pinned}
            title={current || snapshot.pinned ? texts.deleteNot : undefined}
            onClick={() => setDeleting(true)}
          >
            {texts.delete}
          </button>
        </p>
      </details>
      {deleting && (
        <ConfirmDialog
          title={texts.deleteTitle(when)}
          action={texts.deleteAction}
          onConfirm={async () => {
            await api.DELETE("/v1/snapshots/{snapshot_id}", { params });
          }}
          onClose={() => setDeleting(false)}
        >
          <p>{texts.deleteText}</p>
        </ConfirmDialog>
      )}
    </article>
  );
}

function factsOf(metrics: Schemas["SnapshotMetrics"]): string[] {
  return [
    texts.registered(formatCount(metrics.registered)),
    ...(metrics.unregistered ? [texts.unregistered(formatCount(metrics.unregistered))] : []),
    texts.gaussians(formatCount(metrics.gaussians)),
    texts.points(formatCount(metrics.points)),
    ...(metrics.new_images_psnr_db === null
      ? []
      : [texts.newPsnr(formatDecibels(metrics.new_images_psnr_db))]),
    ...(metrics.psnr_db === null ? [] : [texts.heldOutPsnr(formatDecibels(metrics.psnr_db))]),
  ];
}

interface ArtifactProps {
  artifact: Schemas["Artifact"];
  snapshotId: string;
}

function ArtifactLine({ artifact, snapshotId }: ArtifactProps) {
  const [busy, setBusy] = useState(false);
  const save = async () => {
    setBusy(true);
    await download(artifactPath(snapshotId, artifact.name), artifact.name).catch(report);
    setBusy(false);
  };
  return (
    <li>
      <span class="grow">
        {artifact.name} <span class="muted small">{formatBytes(artifact.size_bytes)}</span>
        <span class="muted small what">{strings.work.artifacts[artifact.name] ?? ""}</span>
      </span>
      <button type="button" aria-label={texts.download(artifact.name)} disabled={busy} onClick={save}>
        {strings.photographs.details.download}
      </button>
    </li>
  );
}
