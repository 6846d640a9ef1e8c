import { useEffect, useRef, useState } from "preact/hooks";
import { hrefOf } from "../router";
import { SelectionCard } from "../selection/selection-card";
import { notify } from "../store/notices";
import type { SceneProps, SceneStore } from "../store/scene";
import { strings } from "../strings";
import { KeysDialog } from "./keys-dialog";
import { LayersPanel } from "./layers-panel";
import { Legend } from "./legend";
import { type ViewState, viewState } from "./view-state";
import { Viewer } from "./viewer";
import { ViewpointsPanel } from "./viewpoints-panel";
import "./view3d.css";

const texts = strings.view3d;

/** The scene in three dimensions: its splat with cameras, candidates and routes. */
export function View3d({ store }: SceneProps) {
  const state = viewState();
  const host = useRef<HTMLDivElement>(null);
  const [viewer, setViewer] = useState<Viewer | null>(null);
  const [help, setHelp] = useState(false);
  useEffect(() => {
    if (!host.current) return undefined;
    const made = new Viewer(host.current, store, state);
    setViewer(made);
    return () => made.dispose();
  }, [store]);
  useDeletedSnapshot(store);
  const hovered = state.hovered.value;
  return (
    <div class="view3d">
      {/* biome-ignore lint/a11y/noNoninteractiveTabindex: the keys of an application move its view */}
      <div ref={host} class="view3d-canvas" role="application" aria-label={texts.label} tabIndex={0} />
      {viewer && (
        <div class="view3d-tools" role="toolbar" aria-label={texts.tools}>
          <button type="button" onClick={() => viewer.fitAll()} title={texts.keys.fit}>
            {texts.fit}
          </button>
          <button type="button" onClick={() => viewer.top()} title={texts.keys.top}>
            {texts.top}
          </button>
          {store.selection.value && (
            <button type="button" onClick={() => viewer.focus()} title={texts.keys.focus}>
              {texts.focus}
            </button>
          )}
          {store.lookThrough.value && (
            <button type="button" class="primary" onClick={() => viewer.command("Escape")}>
              {texts.leave}
            </button>
          )}
          <button type="button" onClick={() => setHelp(true)}>
            {texts.help}
          </button>
          <ViewpointsPanel store={store} viewer={viewer} />
          <LayersPanel state={state} />
        </div>
      )}
      <Emptiness store={store} />
      <div class="view3d-foot">
        <ModelStatus state={state} />
        {viewer && <Legend store={store} state={state} viewer={viewer} />}
      </div>
      {hovered && (
        <div class="view3d-label" style={{ left: `${hovered.at[0] + 14}px`, top: `${hovered.at[1] + 14}px` }}>
          {hovered.marker.label}
        </div>
      )}
      <p class="visually-hidden" aria-live="polite">
        {hovered?.marker.label}
      </p>
      <SelectionCard store={store} />
      {help && <KeysDialog onClose={() => setHelp(false)} />}
    </div>
  );
}

/** The chosen snapshot may be deleted under the page. */
function useDeletedSnapshot(store: SceneStore): void {
  const chosen = store.chosenSnapshot.value;
  const gone = chosen !== null && store.snapshots.value.length > 0 && store.snapshot.value?.id !== chosen;
  useEffect(() => {
    if (!gone) return;
    store.chosenSnapshot.value = null;
    notify("warning", texts.snapshotDeleted);
  }, [gone]);
}

/** What to do where there is nothing to see yet. */
function Emptiness({ store }: SceneProps) {
  if (store.connection.value === "connecting" || store.snapshot.value !== null) return null;
  const images = store.images.value;
  const panel = images.length === 0 ? ("photographs" as const) : ("work" as const);
  const placed = images.some((image) => image.prior?.latitude_deg != null || image.prior?.x_m != null);
  const text = images.length === 0 ? texts.noImages : placed ? texts.priorsOnly : texts.noModel;
  return (
    <p class={`view3d-empty ${placed ? "aside" : ""}`}>
      {text}{" "}
      <a href={hrefOf({ page: "scene", sceneId: store.id, stage: "view3d", panel })}>
        {strings.panels[panel]}
      </a>
    </p>
  );
}

function ModelStatus({ state: { model, contextLost, frameMs, gl } }: { state: ViewState }) {
  const now = model.value;
  if (contextLost.value)
    return (
      <p class="view3d-status warning" role="status">
        {texts.contextLost}
      </p>
    );
  if (now.kind === "failed")
    return (
      <p class="view3d-status error" role="alert">
        {now.message}
      </p>
    );
  const text = {
    none: "",
    loading: texts.loadingSplat,
    local: frameMs.value === null ? "" : texts.drawnHere(1000 / frameMs.value),
    service:
      now.kind === "service"
        ? [texts.drawnByService(now.latencyMs), texts.whyByService[gl]].filter(Boolean).join(": ")
        : "",
  }[now.kind];
  return (
    <p class="view3d-status" role="status">
      {text}
    </p>
  );
}
