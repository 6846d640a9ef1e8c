import { colourOf, cssOf } from "../components/colour-map";
import type { SceneStore } from "../store/scene";
import { strings } from "../strings";
import { theme, vehicleColour } from "../theme";
import { contentOf } from "./content";
import { forecastOf } from "./forecast";
import type { ViewState } from "./view-state";
import type { Viewer } from "./viewer";

const texts = strings.view3d.legend;
const STEPS = 12;

/** What the colours in the view mean; only of what is there and shown. */
export function Legend({ store, state, viewer }: { store: SceneStore; state: ViewState; viewer: Viewer }) {
  const shown = state.shown.value;
  const { markers, routes, metres } = contentOf(store);
  const forecast = forecastOf(store);
  const kinds = new Set(markers.filter((one) => shown.has(one.layer)).map((one) => one.paint.kind));
  const plain = (["registered", "unregistered", "unranked", "going-to", "taken", "failed"] as const).filter(
    (kind) => kinds.has(kind),
  );
  return (
    <ul class="view3d-legend" aria-label={texts.label}>
      {plain.map((kind) => (
        <li key={kind}>
          <span class="swatch" style={{ background: `var(--marker-${kind})` }} /> {texts.kinds[kind]}
        </li>
      ))}
      {kinds.has("rank") && (
        <li>
          <ColourBar /> {texts.rank}
        </li>
      )}
      {shown.has("route") &&
        routes.map((route) => (
          <li key={route.vehicle}>
            <span class="swatch" style={{ background: `var(${vehicleColour(route.vehicle)})` }} />{" "}
            {texts.vehicle(route.vehicle)}
          </li>
        ))}
      {forecast && shown.has("forecast") && (
        <li>
          {texts.forecast[forecast.unit]} {forecast.ends[0].toPrecision(3)} <ColourBar />{" "}
          {forecast.ends[1].toPrecision(3)}
        </li>
      )}
      {shown.has("grid") && <li>{texts.grid(viewer.stage.gridSpacing * (metres ?? 1), metres !== null)}</li>}
    </ul>
  );
}

/** The colour map from its first value to its last. */
function ColourBar() {
  const now = theme.value;
  return (
    <span class="colour-bar">
      {Array.from({ length: STEPS }, (_, step) => step / (STEPS - 1)).map((value) => (
        <span key={value} style={{ background: cssOf(colourOf(value, now)) }} />
      ))}
    </span>
  );
}
