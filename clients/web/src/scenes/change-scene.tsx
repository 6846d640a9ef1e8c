import { useState } from "preact/hooks";
import { api, type Schemas } from "../api/service";
import { ConfirmDialog } from "../components/confirm-dialog";
import { Dialog } from "../components/dialog";
import { formatBytes, formatCount } from "../components/format";
import { notify, report } from "../store/notices";
import { strings } from "../strings";
import type { SceneDetails } from "./scene-details";

interface ChangeProps {
  scene: Schemas["Scene"];
  /** Called after the change. */
  onDone: () => void;
  onClose: () => void;
}

/** Asks for another name of a scene. */
export function RenameScene({ scene, onDone, onClose }: ChangeProps) {
  const [busy, setBusy] = useState(false);
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    const name = String(new FormData(event.currentTarget as HTMLFormElement).get("name")).trim();
    setBusy(true);
    try {
      await api.PATCH("/v1/scenes/{scene_id}", {
        params: { path: { scene_id: scene.id } },
        body: { name },
      });
      onDone();
      onClose();
    } catch (error) {
      report(error);
      setBusy(false);
    }
  };
  return (
    <Dialog title={strings.scenes.rename} onClose={onClose}>
      <form onSubmit={submit} class="fields">
        <label>
          {strings.scenes.form.name}
          <input
            name="name"
            required
            maxLength={200}
            autocomplete="off"
            pattern=".*\S.*"
            defaultValue={scene.name}
          />
        </label>
        <p class="actions">
          <button type="button" onClick={onClose}>
            {strings.components.cancel}
          </button>
          <button type="submit" class="primary" disabled={busy}>
            {strings.scenes.form.save}
          </button>
        </p>
      </form>
    </Dialog>
  );
}

/** Says what is lost with a scene, and deletes it once that is agreed to. */
export function DeleteScene({ scene, details, onDone, onClose }: ChangeProps & { details: SceneDetails }) {
  const texts = strings.scenes.deletion;
  const remove = async () => {
    await api.DELETE("/v1/scenes/{scene_id}", { params: { path: { scene_id: scene.id } } });
    notify("success", texts.done(scene.name));
    onDone();
  };
  return (
    <ConfirmDialog
      title={texts.title(scene.name)}
      action={texts.action}
      agreement={texts.agreement(scene.name)}
      onConfirm={remove}
      onClose={onClose}
    >
      <p>{texts.loses}</p>
      <ul>
        <li>{texts.photographs(scene.image_counts.received, formatCount(scene.image_counts.received))}</li>
        {scene.snapshot_id !== null && <li>{texts.models}</li>}
        {details.size && <li>{texts.size(formatBytes(details.size.total_bytes))}</li>}
        {details.job && <li>{texts.job}</li>}
      </ul>
    </ConfirmDialog>
  );
}
