import { colourOf, cssOf } from "../components/colour-map";
import { CheckField } from "../components/fields";
import { formatPercent } from "../components/format";
import { strings } from "../strings";
import { theme, vehicleColour } from "../theme";
import { shareOf } from "./ground-grid";
import { LAYERS, type Layer, shownLayers, toggleLayer } from "./layers";
import type { MapState } from "./map-state";
import { ENOUGH } from "./map-state";
import { overlapColour } from "./paint-ground";

/** On narrower screens the list would hide much of the map until it is wanted. */
const WIDE_PX = 1600;

/** The layers of the map, with what their colours mean. */
export function LayerList({ map }: { map: MapState }) {
  return (
    <details class="map-layers" open={innerWidth >= WIDE_PX}>
      <summary>{strings.map.layersTitle}</summary>
      {LAYERS.map((layer) => (
        <div key={layer}>
          <CheckField checked={shownLayers.value.has(layer)} onChecked={() => toggleLayer(layer)}>
            {strings.map.layers[layer]}
          </CheckField>
          {shownLayers.value.has(layer) && <Legend layer={layer} map={map} />}
        </div>
      ))}
    </details>
  );
}

function Legend({ layer, map }: { layer: Layer; map: MapState }) {
  const { legend } = strings.map;
  const { contents } = map;
  switch (layer) {
    case "photographs": {
      const found = new Set(contents.photographs.value.map((one) => one.registration));
      const others = found.has("unused") || found.has("excluded") || found.has("quarantined");
      return (
        <ul>
          {found.has("registered") && <Key sign="dot accent" text={legend.registered} />}
          {found.has("pending") && <Key sign="ring warn" text={legend.pending} />}
          {found.has("unregistered") && <Key sign="cross bad" text={legend.unregistered} />}
          {others && <Key sign="ring muted" text={legend.left} />}
        </ul>
      );
    }
    case "footprints":
      return <FootprintLegend map={map} />;
    case "overlap":
      return <OverlapLegend map={map} />;
    case "forecast":
      return <ForecastLegend map={map} />;
    case "candidates":
      return contents.candidates.value.length ? <RankLegend /> : null;
    case "plan":
      return (
        <ul>
          {contents.tours.value.map(({ vehicle }) => (
            <Key key={vehicle} colour={`var(${vehicleColour(vehicle)})`} text={legend.tour(vehicle)} />
          ))}
        </ul>
      );
    default:
      return null;
  }
}

function FootprintLegend({ map }: { map: MapState }) {
  const { contents } = map;
  const { legend } = strings.map;
  const asked = contents.ground.value === null || contents.groundIsAssumed.value;
  const registered = contents.footprints.value.some((one) => one.registered);
  const prior = contents.footprints.value.some((one) => !one.registered);
  return (
    <>
      {asked && contents.frame.value.enu !== null && <FlightHeight map={map} />}
      <ul>
        {registered && <Key sign="line accent" text={legend.footprint} />}
        {prior && <Key sign="line warn dashed" text={legend.priorFootprint} />}
      </ul>
    </>
  );
}

function FlightHeight({ map }: { map: MapState }) {
  return (
    <div class="map-question">
      <p class="hint">{strings.map.noGround}</p>
      <label>
        {strings.map.flightHeight}
        <input
          type="number"
          min="1"
          step="1"
          value={map.contents.flightHeight.value ?? ""}
          onChange={({ currentTarget }) => {
            const height = currentTarget.valueAsNumber;
            map.contents.flightHeight.value = height > 0 ? height : null;
          }}
        />
      </label>
    </div>
  );
}

function OverlapLegend({ map }: { map: MapState }) {
  const grid = map.contents.overlap.value;
  if (grid === null) return null;
  return (
    <ul>
      {[0, 1, 2, 3].map((count) => (
        <Key
          key={count}
          colour={cssOf(overlapColour(count))}
          text={strings.map.legend.seen(
            count < ENOUGH ? String(count) : `${ENOUGH}+`,
            formatPercent(shareOf(grid, (value) => (count < ENOUGH ? value === count : value >= ENOUGH))),
          )}
        />
      ))}
    </ul>
  );
}

function ForecastLegend({ map }: { map: MapState }) {
  const { legend } = strings.map;
  const forecast = map.contents.forecast.value;
  if (forecast === null) return <p class="hint map-note">{legend.noForecast}</p>;
  const text = (value: number) => value.toFixed(forecast.unit === "dB" ? 1 : 2);
  return (
    <ul>
      <li>{legend[forecast.unit]}</li>
      <Scale
        from={`${text(forecast.worst)} ${legend.unknown}`}
        to={`${text(forecast.best)} ${legend.known}`}
      />
    </ul>
  );
}

/** The colour map of the page, from what stands out most. */
function Scale({ from, to }: { from: string; to: string }) {
  const stops = [0, 0.25, 0.5, 0.75, 1].map((at) => cssOf(colourOf(at, theme.value))).join(", ");
  return (
    <li class="map-scale">
      {from}
      <span style={{ backgroundImage: `linear-gradient(to right, ${stops})` }} />
      {to}
    </li>
  );
}

function RankLegend() {
  const { legend } = strings.map;
  return (
    <ul>
      <Scale from={legend.best} to={legend.worst} />
      <Key sign="ring muted" text={legend.notRanked} />
    </ul>
  );
}

function Key({ sign = "dot", colour, text }: { sign?: string; colour?: string; text: string }) {
  return (
    <li>
      <span class={`map-key ${sign}`} style={colour ? { backgroundColor: colour } : {}} aria-hidden="true" />{" "}
      {text}
    </li>
  );
}
