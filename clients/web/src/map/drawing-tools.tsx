import { useState } from "preact/hooks";
import { strings } from "../strings";
import type { MapState } from "./map-state";
import { parsePlace } from "./places";
import { USES } from "./sketch";

/** Where the page is as narrow as a tablet's, so that hints would cover the map that is drawn on. */
const NARROW = matchMedia("(max-width: 1200px)");

/** Begins and ends drawings. */
export function DrawingTools({ map }: { map: MapState }) {
  const { sketch } = map;
  const texts = strings.map;
  const current = sketch.use.value;
  const finish = () => sketch.finish();
  if (current !== null)
    return (
      <section class="map-card" aria-label={texts.draw}>
        <h2>{texts.uses[current]}</h2>
        <details open={!NARROW.matches}>
          <summary>{texts.howToDraw}</summary>
          <p class="hint">
            {texts.useHints[current]} {texts.drawHint}
          </p>
          <TypedCorner map={map} />
        </details>
        {sketch.refusal.value && (
          <p class="error" role="alert">
            {sketch.refusal.value}
          </p>
        )}
        <p class="actions">
          <button type="button" class="quiet" onClick={() => sketch.cancel()}>
            {strings.components.cancel}
          </button>
          <button type="button" disabled={!sketch.corners.value.length} onClick={() => sketch.removeLast()}>
            {texts.removeLast}
          </button>
          <button type="button" class="primary" onClick={finish}>
            {texts.finish}
          </button>
        </p>
      </section>
    );
  return (
    <fieldset class="map-tools">
      <legend>{texts.draw}</legend>
      {USES.map((use) => (
        <button
          key={use}
          type="button"
          title={texts.useHints[use]}
          onClick={() => {
            sketch.begin(use);
            document.querySelector<HTMLElement>(".map-canvas")?.focus();
          }}
        >
          {texts.uses[use]}
        </button>
      ))}
    </fieldset>
  );
}

/** Places farther from the scene are mistakes. */
export const FAR_M = 100_000;

/** A corner by its coordinates. */
function TypedCorner({ map }: { map: MapState }) {
  const [refusal, setRefusal] = useState("");
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    const form = event.currentTarget as HTMLFormElement;
    const place = parsePlace(String(new FormData(form).get("place")));
    const corner = place && map.contents.cornersOf([place])[0];
    if (!corner) setRefusal(strings.map.notAPlace);
    else if (Math.hypot(...corner) > FAR_M)
      setRefusal(strings.map.farAway((Math.hypot(...corner) / 1000).toFixed(0)));
    else {
      setRefusal("");
      map.sketch.add(corner);
      form.reset();
    }
  };
  return (
    <form class="map-row" onSubmit={submit}>
      <label>
        {strings.map.typeCorner}
        <input name="place" autocomplete="off" inputmode="text" aria-describedby="place-refusal" />
      </label>
      <button type="submit">{strings.map.addCorner}</button>
      {refusal && (
        <p id="place-refusal" class="error" role="alert">
          {refusal}
        </p>
      )}
    </form>
  );
}
