import { useState } from "preact/hooks";
import { api, type Schemas } from "../api/service";
import { formatCount } from "../components/format";
import { report } from "../store/notices";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";

const texts = strings.work.start;
type Kind = "update" | "fine";

/** Starts an update or a fine model, with the service's defaults unless settings are given. */
export function StartJob({ store }: SceneProps) {
  const [kind, setKind] = useState<Kind>("update");
  const [busy, setBusy] = useState(false);
  const counts = store.scene.value?.image_counts;
  if (!counts) return null;
  const hasModel = store.snapshots.value.length > 0;
  const possible = kind === "update" ? counts.accepted > 0 : hasModel;
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    const fields = new FormData(event.currentTarget as HTMLFormElement);
    setBusy(true);
    await api
      .POST("/v1/scenes/{scene_id}/jobs", {
        params: { path: { scene_id: store.id }, header: { "Idempotency-Key": newKey() } },
        body: requestOf(kind, (name) => String(fields.get(name) ?? "")),
      })
      .catch(report);
    setBusy(false);
  };
  return (
    <form class="start-job" aria-label={texts.title} onSubmit={submit}>
      <div class="head">
        <select
          aria-label={texts.title}
          value={kind}
          onChange={(event) => setKind(event.currentTarget.value as Kind)}
        >
          <option value="update">{texts.update}</option>
          <option value="fine">{texts.fine}</option>
        </select>
        <button type="submit" class="primary" disabled={busy || !possible}>
          {texts.button}
        </button>
      </div>
      <p class="hint small">{hintOf(kind, counts, hasModel)}</p>
      <details>
        <summary class="small">{texts.settings}</summary>
        <div class="fields">
          {(kind === "fine" || !hasModel) && (
            <>
              <Field name="iterations" label={texts.iterations} min={1} max={100_000} />
              <Field name="long_side_px" label={texts.longSide} min={64} max={8192} />
            </>
          )}
          {kind === "fine" && (
            <Field name="test_every" label={texts.testEvery} min={2} max={1000} hint={texts.testEveryHint} />
          )}
          {kind === "update" && <p class="hint small">{texts.first}</p>}
        </div>
      </details>
    </form>
  );
}

interface FieldProps {
  name: string;
  label: string;
  min: number;
  max: number;
  hint?: string;
}

function Field({ name, label, min, max, hint }: FieldProps) {
  return (
    <label>
      {label}
      <input name={name} type="number" min={min} max={max} step={1} placeholder={texts.byDefault} />
      {hint && <span class="hint">{hint}</span>}
    </label>
  );
}

/** The request of a job from the fields of the form; empty ones are left to the service. */
export function requestOf(kind: Kind, field: (name: string) => string): Schemas["JobRequest"] {
  const names = ["iterations", "long_side_px", ...(kind === "fine" ? ["test_every"] : [])];
  const given = names.filter((name) => field(name).trim() !== "");
  return { kind, ...Object.fromEntries(given.map((name) => [name, Number(field(name))])) };
}

function hintOf(kind: Kind, counts: Schemas["ImageCounts"], hasModel: boolean): string {
  if (kind === "fine") return hasModel ? texts.fineHint : texts.fineNone;
  if (counts.accepted === 0) return texts.updateNone;
  return counts.pending > 0
    ? texts.updateHint(counts.pending, formatCount(counts.pending))
    : texts.updateNothing;
}

/** A key by which the service knows a request that is sent twice; `randomUUID` needs a secure context. */
function newKey(): string {
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16)).join("-");
}
