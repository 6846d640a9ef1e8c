import type { SceneEvent } from "../api/events";
import type { Schemas } from "../api/service";

type Image = Schemas["Image"];

/** Images in the order of arrival, after events of images, which carry what has changed. */
export function afterEvents(images: readonly Image[], events: readonly SceneEvent[]): readonly Image[] {
  if (events.length === 0) return images;
  const now = new Map(images.map((image) => [image.digest, image]));
  for (const { kind, data, scene_id } of events) {
    const digest = data["digest"] as string;
    const known = now.get(digest);
    if (kind === "image.deleted") now.delete(digest);
    else if (kind === "image.received") now.set(digest, { ...data, scene_id } as unknown as Image);
    else if (known) now.set(digest, { ...known, ...data });
  }
  return [...now.values()].sort((one, other) => one.number - other.number);
}
