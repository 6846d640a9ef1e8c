import { useState } from "preact/hooks";
import { api, data } from "../api/service";
import { Dialog } from "../components/dialog";
import { go } from "../router";
import { report } from "../store/notices";
import { strings } from "../strings";

const { form } = strings.scenes;

/** Asks for the name of a new scene, and when its model is updated; then goes there. */
export function NewScene({ onClose }: { onClose: () => void }) {
  const [automatic, setAutomatic] = useState(false);
  const [busy, setBusy] = useState(false);
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    const fields = new FormData(event.currentTarget as HTMLFormElement);
    const number = (name: string) => Number(fields.get(name));
    const policy = automatic
      ? { trigger: "every-k-images" as const, k: number("k"), first: number("first") }
      : { trigger: "on-request" as const };
    setBusy(true);
    try {
      const body = { name: String(fields.get("name")).trim(), policy };
      const scene = await data(api.POST("/v1/scenes", { body }));
      onClose();
      go({ page: "scene", sceneId: scene.id, stage: "view3d", panel: "photographs" });
    } catch (error) {
      report(error);
      setBusy(false);
    }
  };
  return (
    <Dialog title={strings.scenes.create} onClose={onClose}>
      <form onSubmit={submit} class="fields">
        <label>
          {form.name}
          <input name="name" required maxLength={200} autocomplete="off" pattern=".*\S.*" />
          <span class="hint">{form.nameHint}</span>
        </label>
        <label>
          {form.policy}
          <select onChange={(event) => setAutomatic(event.currentTarget.value === "automatic")}>
            <option value="request">{form.onRequest}</option>
            <option value="automatic">{form.everyK}</option>
          </select>
        </label>
        {automatic && (
          <div class="fields-row">
            <label>
              {form.first}
              <input name="first" type="number" min={2} max={10000} defaultValue="8" required />
              <span class="hint">{form.firstHint}</span>
            </label>
            <label>
              {form.k}
              <input name="k" type="number" min={1} max={10000} defaultValue="10" required />
            </label>
          </div>
        )}
        <p class="actions">
          <button type="button" onClick={onClose}>
            {strings.components.cancel}
          </button>
          <button type="submit" class="primary" disabled={busy}>
            {form.create}
          </button>
        </p>
      </form>
    </Dialog>
  );
}
