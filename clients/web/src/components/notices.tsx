import { dismiss, notices } from "../store/notices";
import { strings } from "../strings";

/** Notices in the lower corner; read out by screen readers as they come. */
export function Notices() {
  return (
    <div class="notices" role="status" aria-live="polite">
      {notices.value.map((one) => (
        <div class={`notice ${one.kind}`} key={one.id}>
          <p>
            {one.message} {one.hint && <span class="hint">{one.hint}</span>}
          </p>
          <button type="button" class="quiet" aria-label={strings.dismiss} onClick={() => dismiss(one.id)}>
            ×
          </button>
        </div>
      ))}
    </div>
  );
}
