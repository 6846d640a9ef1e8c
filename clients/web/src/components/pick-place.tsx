import { useEffect, useRef } from "preact/hooks";
import { show } from "../router";
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
  const give = useRef(onPlace);
  give.current = onPlace; // as it is when the place is clicked
  const take = useRef((place: Place) => give.current(place)).current;
  const stop = () => {
    if (store.pick.peek() === take) store.pick.value = null;
  };
  useEffect(() => stop, [store]);
  const waiting = store.pick.value === take;
  const pick = () => {
    if (waiting) return stop();
    store.pick.value = take;
    show({ stage: "map" });
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
