import { ServiceError, wordsOf } from "../api/problem";
import { strings } from "../strings";

interface FailureProps {
  error: unknown;
  /** Does again what failed. */
  onRetry: () => void;
}

/** Why something failed, with its hint, in the place where it was asked for. */
export function Failure({ error, onRetry }: FailureProps) {
  if (error === null) return null;
  const { message, hint } = wordsOf(error);
  return (
    <div class="failure" role="alert">
      <p class="error">{message}</p>
      {hint && <p class="hint">{hint}</p>}
      {error instanceof ServiceError && (
        <button type="button" onClick={onRetry}>
          {strings.components.retry}
        </button>
      )}
    </div>
  );
}
