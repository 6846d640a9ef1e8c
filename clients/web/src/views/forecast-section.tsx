import { siteOf } from "../candidates/site";
import { Failure } from "../components/failure";
import { SelectField } from "../components/fields";
import { formatShare } from "../components/format";
import { planRun } from "../plans/plan-run";
import { show } from "../router";
import type { SceneProps, SceneStore } from "../store/scene";
import { strings } from "../strings";
import { FORECAST_PLACES, type ForecastPlace, leastKnown, summaryOf } from "./forecast-form";
import { forecastRun } from "./forecast-run";

const texts = strings.views.forecast;

/** Shows what the model does not know, and plans a flight there. */
export function ForecastSection({ store }: SceneProps) {
  const run = forecastRun(store);
  const place = run.place.value;
  const forecast = store.forecast.value;
  const fly = () => {
    const site = siteOf(store);
    if (!place || !forecast || !site) return;
    void planRun(store).startFrom(leastKnown(place, forecast, site));
    show({ panel: "plans" });
  };
  return (
    <section aria-label={texts.title} class="forecast">
      <h2>{texts.title}</h2>
      <SelectField<ForecastPlace | "">
        label={texts.where}
        value={place ?? ""}
        onValue={(value) => {
          run.place.value = value || null;
        }}
        options={[
          { value: "", title: texts.nowhere },
          ...FORECAST_PLACES.map((value) => ({
            value,
            title: texts.places[value],
            disabled: store.cameras.value === null,
          })),
        ]}
      />
      {run.busy.value && <p role="status">{texts.busy}</p>}
      <Failure error={run.failure.value} onRetry={() => run.again()} />
      {forecast && (
        <>
          <Summary forecast={forecast} />
          <p class="actions">
            <span class="hint grow">{texts.flyHint}</span>
            <button type="button" class="primary" onClick={fly}>
              {texts.fly}
            </button>
          </p>
        </>
      )}
    </section>
  );
}

function Summary({ forecast }: { forecast: NonNullable<SceneStore["forecast"]["value"]> }) {
  const { samples, mean, most, unknown, psnr } = summaryOf(forecast);
  return (
    <p>
      {texts.summary(samples, mean.toFixed(2), most.toFixed(2))} {texts.unknown(formatShare(unknown))}{" "}
      {psnr ? (
        texts.calibrated(psnr.mean.toFixed(1), psnr.least.toFixed(1))
      ) : (
        <span class="hint">{texts.uncalibrated}</span>
      )}{" "}
      <span class="hint">{texts.refreshed}</span>
    </p>
  );
}
