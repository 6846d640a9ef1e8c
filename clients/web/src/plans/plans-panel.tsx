import type { SceneProps } from "../scene/scene-page";

export function PlansPanel({ store }: SceneProps) {
  return <p>{store.id}</p>;
}
