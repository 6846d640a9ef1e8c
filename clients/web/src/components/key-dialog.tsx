import { signal } from "@preact/signals";
import { apiKey, keyRefusal, setKey } from "../api/key";
import { strings } from "../strings";
import { Dialog } from "./dialog";

const malformed = signal(false);

/** Asks for an API key whenever the service refused one, or refused to work without. */
export function KeyDialog() {
  const refusal = keyRefusal.value;
  if (refusal === null) return null;
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    const key = String(new FormData(event.currentTarget as HTMLFormElement).get("key")).trim();
    malformed.value = !/^fvs_[\w-]+$/.test(key);
    if (!malformed.value) setKey(key);
  };
  return (
    <Dialog
      title={strings.key.title}
      onClose={() => {
        keyRefusal.value = null;
      }}
    >
      <form onSubmit={submit}>
        {refusal.message && <p class="error">{refusal.message}</p>}
        <p>{strings.key.explanation}</p>
        <p class="hint">{strings.key.howToGet}</p>
        <label>
          {strings.key.label}
          <input name="key" type="password" autocomplete="off" spellcheck={false} required />
        </label>
        {malformed.value && <p class="error">{strings.key.malformed}</p>}
        <p class="actions">
          {apiKey.value !== null && (
            <button type="button" class="quiet" onClick={() => setKey(null)}>
              {strings.key.forget}
            </button>
          )}
          <button type="submit" class="primary">
            {strings.key.use}
          </button>
        </p>
      </form>
    </Dialog>
  );
}
