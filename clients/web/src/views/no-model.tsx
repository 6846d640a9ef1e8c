import { strings } from "../strings";

/** What to do in a scene without a model. */
export function NoModel() {
  return (
    <p>
      {strings.views.noModel} <span class="hint">{strings.views.noModelHint}</span>
    </p>
  );
}
