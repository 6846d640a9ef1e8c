import { useEffect, useState } from "preact/hooks";
import { ServiceError } from "../api/problem";
import { api, data, type Schemas } from "../api/service";
import { report } from "../store/notices";

/** What a row of the list shows beyond the scene itself; null where it is not known yet or does not exist. */
export interface SceneDetails {
  size: Schemas["SceneSize"] | null;
  snapshot: Schemas["Snapshot"] | null;
  job: Schemas["Job"] | null;
}

/** Load details of a scene that is in sight, and again when `version` changes. */
export function useDetails(scene: Schemas["Scene"], visible: boolean, version: number): SceneDetails {
  const [details, setDetails] = useState<SceneDetails>({ size: null, snapshot: null, job: null });
  useEffect(() => {
    if (!visible) return;
    let wanted = true;
    load(scene)
      .then((loaded) => wanted && setDetails(loaded))
      .catch((error: unknown) => {
        if (!(error instanceof ServiceError && error.status === 404)) report(error); // it was just deleted
      });
    return () => {
      wanted = false;
    };
  }, [scene.id, scene.etag, visible, version]);
  return details;
}

async function load(scene: Schemas["Scene"]): Promise<SceneDetails> {
  const path = { scene_id: scene.id };
  const [size, job, snapshot] = await Promise.all([
    data(api.GET("/v1/scenes/{scene_id}/size", { params: { path } })),
    scene.job === null
      ? null
      : data(api.GET("/v1/jobs/{job_id}", { params: { path: { job_id: scene.job.id } } })),
    scene.snapshot_id === null
      ? null
      : data(
          api.GET("/v1/snapshots/{snapshot_id}", { params: { path: { snapshot_id: scene.snapshot_id } } }),
        ),
  ]);
  return { size, snapshot, job };
}
