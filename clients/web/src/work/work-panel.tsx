import type { SceneProps } from "../scene/scene-page";

export function WorkPanel({ store }: SceneProps) {
  return <p>{store.id}</p>;
}
