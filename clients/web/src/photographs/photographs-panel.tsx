import type { SceneProps } from "../scene/scene-page";

export function PhotographsPanel({ store }: SceneProps) {
  return <p>{store.id}</p>;
}
