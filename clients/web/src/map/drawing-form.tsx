import { useState } from "preact/hooks";
import { formatArea, formatLength } from "../components/format";
import { show } from "../router";
import type { Drawing } from "../store/scene";
import { strings } from "../strings";
import type { MapState } from "./map-state";
import { formatPlace, parsePlace } from "./places";
import { areaOf, lengthOf } from "./polygons";

/** The chosen drawing: its size, heights and corners, and what can be done with it. */
export function DrawingForm({ map }: { map: MapState }) {
  const { store, sketch } = map;
  const texts = strings.map;
  const drawing = store.drawings.value.find((one) => one.id === store.chosenDrawing.value);
  if (!drawing || sketch.use.value !== null) return null;
  const corners = sketch.chosenCorners();
  const line = drawing.use === "corridor";
  return (
    <section class="map-card" aria-label={texts.uses[drawing.use]}>
      <header class="map-row">
        <h2>{texts.uses[drawing.use]}</h2>
        <span class="grow">
          {line
            ? formatLength(lengthOf(corners))
            : `${formatArea(areaOf(corners))}, ${formatLength(lengthOf([...corners, ...corners.slice(0, 1)]))}`}
        </span>
        <button
          type="button"
          class="quiet"
          aria-label={strings.components.close}
          onClick={() => map.escape()}
        >
          ×
        </button>
      </header>
      {drawing.use !== "fence" && <Heights key={drawing.id} map={map} drawing={drawing} />}
      <Corners key={drawing.corners} map={map} drawing={drawing} />
      {sketch.refusal.value && (
        <p class="error" role="alert">
          {sketch.refusal.value}
        </p>
      )}
      <p class="actions">
        <button type="button" class="danger" onClick={() => sketch.remove(drawing.id)}>
          {texts.deleteDrawing}
        </button>
        {(line || drawing.use === "area") && (
          <button
            type="button"
            class="primary"
            title={texts.flyHint}
            onClick={() => show({ panel: "plans" })}
          >
            {texts.fly}
          </button>
        )}
      </p>
    </section>
  );
}

/** The heights of a drawing: above the ground where it is known, else above the scene's origin. */
function Heights({ map, drawing }: { map: MapState; drawing: Drawing }) {
  const texts = strings.map;
  const [wrong, setWrong] = useState(false);
  const ground = map.contents.ground.value;
  const base = Math.round(ground?.typical ?? 0);
  const above = ground ? texts.aboveGround : texts.aboveOrigin;
  const field = (
    label: string,
    value: number,
    change: (value: number) => Partial<Drawing>,
    least?: number,
  ) => (
    <label>
      {label}
      <input
        type="number"
        step="any"
        min={least}
        value={value}
        onChange={({ currentTarget }) => {
          const changed = { ...drawing, ...change(currentTarget.valueAsNumber) };
          const numbers = [changed.lower_m, changed.upper_m, changed.radius_m];
          const usable = numbers.every(Number.isFinite) && changed.radius_m > 0;
          const ordered = drawing.use === "corridor" || changed.lower_m < changed.upper_m;
          setWrong(!ordered);
          if (usable && ordered) map.sketch.change(drawing.id, changed);
        }}
      />
    </label>
  );
  return (
    <div class="map-row">
      {drawing.use === "corridor" ? (
        <>
          {field(texts.lineHeight(above), (drawing.lower_m + drawing.upper_m) / 2 - base, (height) => ({
            lower_m: base + height,
            upper_m: base + height,
          }))}
          {field(texts.radius, drawing.radius_m, (radius_m) => ({ radius_m }), 0.1)}
        </>
      ) : (
        <>
          {field(texts.lower(above), drawing.lower_m - base, (height) => ({ lower_m: base + height }))}
          {field(texts.upper(above), drawing.upper_m - base, (height) => ({ upper_m: base + height }))}
        </>
      )}
      {wrong && (
        <p class="error" role="alert">
          {texts.wrongHeights}
        </p>
      )}
    </div>
  );
}

/** The corners as text: for typing, copying, and work without a mouse. */
function Corners({ map, drawing }: { map: MapState; drawing: Drawing }) {
  const texts = strings.map;
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    const text = String(new FormData(event.currentTarget as HTMLFormElement).get("corners"));
    const places = text.trim().split("\n").map(parsePlace);
    if (places.includes(null)) map.sketch.refusal.value = texts.notAPlace;
    else map.sketch.reshape(map.contents.cornersOf(places as Drawing["corners"]));
  };
  return (
    <details>
      <summary>{texts.corners}</summary>
      <form onSubmit={submit}>
        <textarea
          name="corners"
          rows={5}
          aria-label={texts.corners}
          value={drawing.corners.map(formatPlace).join("\n")}
        />
        <button type="submit">{texts.applyCorners}</button>
      </form>
    </details>
  );
}
