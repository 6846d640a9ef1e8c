import { signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { api, data, type Schemas } from "../api/service";
import { hrefOf } from "../router";
import { report } from "../store/notices";
import { strings } from "../strings";

const scenes = signal<readonly Schemas["Scene"][]>([]);

/** All scenes. */
export function ScenesPage() {
  useEffect(() => {
    data(api.GET("/v1/scenes"))
      .then((list) => {
        scenes.value = list.items;
      })
      .catch(report);
  }, []);
  return (
    <section class="page">
      <h1>{strings.scenes.title}</h1>
      <ul>
        {scenes.value.map((scene) => (
          <li key={scene.id}>
            <a href={hrefOf({ page: "scene", sceneId: scene.id, stage: "view3d", panel: "photographs" })}>
              {scene.name}
            </a>
          </li>
        ))}
      </ul>
    </section>
  );
}
