import type { ComponentType } from "preact";
import { useEffect, useState } from "preact/hooks";
import { lazy } from "../components/lazy";
import { Tabs } from "../components/tabs";
import { PhotographsPanel } from "../photographs/photographs-panel";
import { PlansPanel } from "../plans/plans-panel";
import { hrefOf, PANELS, type Panel, STAGES, type Stage } from "../router";
import { type SceneProps, SceneStore } from "../store/scene";
import { strings } from "../strings";
import { ViewsPanel } from "../views/views-panel";
import { WorkPanel } from "../work/work-panel";
import { SceneTitle } from "./scene-title";

const STAGE_COMPONENTS: Record<Stage, ComponentType<SceneProps>> = {
  view3d: lazy(async () => (await import("../view3d/view3d")).View3d),
  map: lazy(async () => (await import("../map/map-view")).MapView),
  compare: lazy(async () => (await import("../view3d/compare")).Compare),
};
const PANEL_COMPONENTS: Record<Panel, ComponentType<SceneProps>> = {
  photographs: PhotographsPanel,
  views: ViewsPanel,
  plans: PlansPanel,
  work: WorkPanel,
};

interface ScenePageProps {
  sceneId: string;
  stage: Stage;
  panel: Panel;
}

/** One scene: the stage (3D, map or comparison) beside a panel with what is done there. */
export function ScenePage({ sceneId, stage, panel }: ScenePageProps) {
  const [store] = useState(() => new SceneStore(sceneId));
  useEffect(() => () => store.close(), [store]);
  const failure = store.failure.value;
  if (failure !== null) {
    return (
      <section class="page">
        <h1>{failure.message}</h1>
        <p>{failure.hint}</p>
        <a href={hrefOf({ page: "scenes" })}>{strings.backToScenes}</a>
      </section>
    );
  }
  const StageComponent = STAGE_COMPONENTS[stage];
  const PanelComponent = PANEL_COMPONENTS[panel];
  const stages = STAGES.map((id) => ({
    id,
    title: strings.stage[id],
    href: hrefOf({ page: "scene", sceneId, stage: id, panel }),
  }));
  const panels = PANELS.map((id) => ({
    id,
    title: strings.panels[id],
    href: hrefOf({ page: "scene", sceneId, stage, panel: id }),
  }));
  return (
    <div class="scene">
      <SceneTitle store={store} />
      <section class="stage">
        <Tabs label={strings.stages} tabs={stages} current={stage} />
        <StageComponent store={store} />
      </section>
      <aside class="panel">
        <Tabs label={strings.panelsLabel} tabs={panels} current={panel} />
        <PanelComponent store={store} />
      </aside>
    </div>
  );
}
