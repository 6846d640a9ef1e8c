import type { SceneProps } from "../scene/scene-page";

export function View3d({ store }: SceneProps) {
  return <p>{store.id}</p>;
}
