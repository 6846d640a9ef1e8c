import { useRef } from "preact/hooks";
import { go, route } from "../router";
import type { Place, SceneStore } from "../store/scene";
import { strings } from "../strings";

interface PickPlaceProps {
  store: SceneStore;
  place: Place | null;
  onPlace: (place: Place) => void;
}

const texts = strings.views.form;

/** Takes a place by the next click on the map, which is shown for it. */
export function PickPlace({ store, place, onPlace }: PickPlaceProps) {
  const mine = useRef<((place: Place) => void) | null>(null);
  const waiting = store.pick.value !== null && store.pick.value === mine.current;
  const pick = () => {
    if (waiting) {
      store.pick.value = null;
      return;
    }
    mine.current = onPlace;
    store.pick.value = onPlace;
    const now = route.value;
    if (now.page === "scene" && now.stage !== "map") go({ ...now, stage: "map" });
  };
  const digits = (degrees: number) => degrees.toFixed(6);
  return (
    <span class="pick">
      {place && <span>{texts.place(digits(place.latitude_deg), digits(place.longitude_deg))}</span>}
      <button
        type="button"
        aria-pressed={waiting}
        onClick={pick}
        disabled={!store.frames.value?.georeferenced}
      >
        {waiting ? texts.clickNow : texts.clickMap}
      </button>
    </span>
  );
}
