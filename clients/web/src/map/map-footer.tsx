import { strings } from "../strings";
import type { MapState } from "./map-state";
import { fromScreen, scaleLength } from "./viewport";

const LONGEST_PX = 140;

/** The scale, north, and the place under the pointer. */
export function MapFooter({ map }: { map: MapState }) {
  const { frame } = map.contents;
  const { enu, metric } = frame.value;
  const view = map.view.value;
  const length = scaleLength(view, LONGEST_PX);
  return (
    <div class="map-footer">
      {enu !== null && (
        <span class="map-north" role="img" aria-label={strings.map.north} title={strings.map.north}>
          ▲ N
        </span>
      )}
      <span class="map-bar" style={{ width: `${length * view.pxPerUnit}px` }}>
        {metric ? scaleText(length) : length}
      </span>
      <span class="map-place" aria-live={map.byKeys.value ? "polite" : "off"}>
        {placeText(map)}
      </span>
    </div>
  );
}

function placeText(map: MapState): string {
  const at = map.pointer.value;
  if (at === null) return "";
  const { contents } = map;
  const [x, y] = fromScreen(map.view.value, at);
  const ground = contents.ground.value?.heightAt(x, y) ?? null;
  const place = contents.frame.value.placeOf([x, y, ground ?? 0]);
  if (place === null) return `${x.toFixed(2)}, ${y.toFixed(2)}`;
  const coordinates = `${place.latitude_deg.toFixed(7)}°, ${place.longitude_deg.toFixed(7)}°`;
  return ground === null
    ? coordinates
    : `${coordinates}, ${strings.map.ground(`${place.altitude_m.toFixed(1)} m`)}`;
}

function scaleText(length: number): string {
  const { units } = strings.components;
  return length < 1000 ? units.metres(String(length)) : units.kilometres(String(length / 1000));
}
