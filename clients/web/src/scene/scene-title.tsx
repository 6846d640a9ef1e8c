import { strings } from "../strings";
import type { SceneProps } from "./scene-page";

/** The scene's name, whether the page is up to date, and what the service does now. */
export function SceneTitle({ store }: SceneProps) {
  const connection = store.connection.value;
  const job = store.openJob.value;
  return (
    <div class="scene-title">
      <h1>{store.scene.value?.name ?? strings.loading}</h1>
      <span class={`connection ${connection}`} role="status">
        {strings.connection[connection]}
      </span>
      {job && (
        <span class="job">
          {job.kind} {job.stage} <progress value={job.progress} max={1} aria-label={job.kind} />
        </span>
      )}
    </div>
  );
}
