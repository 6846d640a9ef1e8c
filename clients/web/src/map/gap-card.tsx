import { show } from "../router";
import { strings } from "../strings";
import type { MapState } from "./map-state";

/** The gap that was chosen on the map, and how to close it: by an area around it that is planned. */
export function GapCard({ map }: { map: MapState }) {
  const gap = map.gap.value;
  if (gap === null) return null;
  const texts = strings.map.gap;
  const fly = () => {
    map.sketch.keep("area", gap.corners);
    map.gap.value = null;
    show({ panel: "plans" }); // which plans in the chosen drawing
  };
  return (
    <section class="map-card" role="status">
      <p>{texts[gap.kind](gap.value)}</p>
      <p class="actions">
        <button type="button" class="quiet" onClick={() => map.escape()}>
          {strings.components.close}
        </button>
        {map.contents.frame.value.enu !== null && (
          <button type="button" class="primary" onClick={fly}>
            {texts.fly}
          </button>
        )}
      </p>
    </section>
  );
}
