import { effect } from "@preact/signals";
import { UploadQueue } from "./upload-queue";
import { SceneUploads } from "./upload-service";

const queues = new Map<string, UploadQueue>();

/** The uploads to a scene; they go on while the page shows something else. */
export function uploadsOf(sceneId: string): UploadQueue {
  const known = queues.get(sceneId);
  if (known) return known;
  const queue = new UploadQueue(new SceneUploads(sceneId));
  queues.set(sceneId, queue);
  effect(() => {
    if (queue.totals.value.open > 0) addEventListener("beforeunload", warn);
    else if (![...queues.values()].some((one) => one.totals.peek().open > 0)) {
      removeEventListener("beforeunload", warn);
    }
  });
  return queue;
}

/** Let the browser ask whether to leave the page. */
function warn(event: BeforeUnloadEvent): void {
  event.preventDefault();
}
