import type { Schemas } from "../api/service";
import { strings } from "../strings";

const NAMED = 5;

/** Warnings of a result: what was found, which candidates it is about, and what to do. */
export function WarningsList({ warnings }: { warnings: readonly Schemas["Notice"][] }) {
  if (warnings.length === 0) return null;
  return (
    <section aria-label={strings.views.table.warnings}>
      <ul class="warnings">
        {warnings.map((one) => (
          <li key={one.code}>
            <span class="warning">{one.message}</span> <span class="hint">{one.hint}</span>
            {one.candidates.length > 0 && (
              <span class="hint">
                {" "}
                {strings.views.table.names(one.candidates.slice(0, NAMED), one.candidates.length - NAMED)}
              </span>
            )}
          </li>
        ))}
      </ul>
    </section>
  );
}
