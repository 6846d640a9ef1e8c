import type { SceneProps } from "../scene/scene-page";

export function ViewsPanel({ store }: SceneProps) {
  return <p>{store.id}</p>;
}
