import type { SceneProps } from "../scene/scene-page";

export function MapView({ store }: SceneProps) {
  return <p>{store.id}</p>;
}
