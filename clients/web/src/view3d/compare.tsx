import type { SceneProps } from "../scene/scene-page";

export function Compare({ store }: SceneProps) {
  return <p>{store.id}</p>;
}
