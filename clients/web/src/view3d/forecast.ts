import type { Triple } from "../api/artifacts";
import type { Schemas } from "../api/service";
import { poseOf } from "../geometry/frames";
import type { SceneStore } from "../store/scene";
import { framesOf, placedBy } from "./content";

/** A place with how little is known of it: the colour's value from 0 (least known) to 1. */
export interface Sample {
  position: Triple;
  value: number;
}

/** A forecast in the shown model: its samples, and the quantity at the ends of the colours. */
export interface ShownForecast {
  unit: "variance" | "dB";
  /** The quantity of what is least known, and of what is known best. */
  ends: [number, number];
  samples: readonly Sample[];
}

/** The forecast that the store shows, in dB where it is calibrated; null while it shows none. */
export function forecastOf(store: SceneStore): ShownForecast | null {
  const forecast = store.forecast.value;
  if (!forecast || forecast.samples.length === 0) return null;
  const place = placedBy(forecast, store, framesOf(store));
  const quantity = (sample: Schemas["ForecastSample"]) =>
    forecast.calibrated ? sample.psnr_db : sample.variance;
  const values = forecast.samples.map((sample) => quantity(sample) ?? 0);
  const [low, high] = [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))];
  const ends: [number, number] = forecast.calibrated ? [low, high] : [high, low];
  const samples = forecast.samples.flatMap((sample, index) => {
    const position = place(poseOf(sample))?.position;
    const value = ((values[index] as number) - ends[0]) / (ends[1] - ends[0] || 1);
    return position ? [{ position, value }] : [];
  });
  return { unit: forecast.calibrated ? "dB" : "variance", ends, samples };
}
