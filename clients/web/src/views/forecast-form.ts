import type { Triple } from "../api/artifacts";
import type { Schemas } from "../api/service";
import { CANDIDATES, type CandidatesForm, generatorOf } from "../candidates/candidates-form";
import { levelAxes, type Pose, type Site, upwards, usualRadius } from "../candidates/site";
import { dot, length, minus, times } from "../geometry/vectors";
import type { From } from "../plans/plan-form";

/** Where it is shown what the model does not know. */
export const FORECAST_PLACES = ["ground", "surface", "candidates"] as const;
export type ForecastPlace = (typeof FORECAST_PLACES)[number];

const GRID = 30;
const SURFACE = 4000;
/** How many of the least known candidates a plan chooses from. */
const FLOWN = 60;
/** The share of a surface that counts as its least known part. */
const LEAST_KNOWN = 0.05;

/** The request for a forecast at a place: over the candidates of a ranking, or of a form where there is none. */
export function forecastRequest(
  place: ForecastPlace,
  site: Site,
  ranking: Schemas["Ranking"] | null,
  form: CandidatesForm,
  snapshotId: string | null,
): Schemas["ForecastRequest"] {
  return {
    ...sourceOf(place, site, ranking, form),
    frame: site.frames.georeferenced ? "geodetic" : "world",
    ...(snapshotId !== null && { snapshot_id: snapshotId }),
  };
}

function sourceOf(
  place: ForecastPlace,
  site: Site,
  ranking: Schemas["Ranking"] | null,
  form: CandidatesForm,
): Schemas["ForecastRequest"] {
  if (place === "surface") return { surface: { count: SURFACE } };
  if (place === "ground") return { generator: { kind: "grid", columns: GRID, rows: GRID, look: "down" } };
  if (ranking) return { candidates: ranking.candidates.map(({ id, pose }) => ({ id, pose })) };
  const generator = generatorOf(form, site);
  return {
    generator: generator.kind === "around-current" ? { kind: CANDIDATES.source as "orbit" } : generator,
  };
}

/** What a forecast says, in numbers. */
export interface ForecastSummary {
  samples: number;
  mean: number;
  most: number;
  /** The share of samples with a variance above one half. */
  unknown: number;
  /** The mean and the least PSNR to expect; null until the forecast is calibrated. */
  psnr: { mean: number; least: number } | null;
}

export function summaryOf(forecast: Schemas["Forecast"]): ForecastSummary {
  const { samples, calibrated } = forecast;
  const variances = samples.map(({ variance }) => variance);
  const levels = samples.flatMap(({ psnr_db }) => (psnr_db === null ? [] : [psnr_db]));
  return {
    samples: samples.length,
    mean: mean(variances),
    most: variances.reduce((most, one) => Math.max(most, one), 0),
    unknown: mean(variances.map((one) => (one > 0.5 ? 1 : 0))),
    psnr:
      calibrated && levels.length > 0
        ? { mean: mean(levels), least: levels.reduce((least, one) => Math.min(least, one)) }
        : null,
  };
}

/**
 * Candidates for a flight to where a forecast has the highest variance.
 *
 * Over the ground they are among the photographs: outside of these the variance is highest everywhere, and a view
 * from there could not be registered.
 */
export function leastKnown(place: ForecastPlace, forecast: Schemas["Forecast"], site: Site): From {
  const sorted = [...forecast.samples].sort((a, b) => b.variance - a.variance);
  const views = sorted.flatMap(({ id, pose }) => (pose ? [{ id, pose }] : []));
  const among = place === "ground" ? amongPhotographs(views, site) : views;
  if (among.length > 0) return { candidates: spread(among.slice(0, Math.max(FLOWN, among.length / 2))) };
  const worst = sorted.slice(0, Math.max(1, Math.round(sorted.length * LEAST_KNOWN)));
  const places = worst.flatMap(({ position }) => (position ? [worldPosition(position, site)] : []));
  const centre = median(places);
  const distance = 2 * usualRadius(site);
  const volume = {
    kind: "shell" as const,
    centre,
    inner: 0.5 * distance,
    outer: 1.1 * distance,
    above: 0,
    up: upwards(site),
  };
  return { generator: { kind: "in-volume", volume, count: FLOWN, aim: nearest(places, centre) } };
}

/** Those that photographs surround, as seen from above, and those as near to one as its neighbour is. */
function amongPhotographs<View extends { pose: Pose }>(views: readonly View[], site: Site): View[] {
  const up = upwards(site);
  const flat = (point: Triple) => minus(point, times(up, dot(point, up)));
  const photographs = site.cameras.views.map((view) => flat(site.frames.worldFromModel(view.position)));
  const near = middle(
    photographs.map((one) =>
      nearestDistance(
        one,
        photographs.filter((other) => other !== one),
      ),
    ),
  );
  const [east, north] = levelAxes(up);
  return views.filter(({ pose }) => {
    const camera = site.frames.cameraInModel(pose);
    if (!camera) return false;
    const place = flat(site.frames.worldFromModel(camera.position));
    if (nearestDistance(place, photographs) <= near / 2) return true;
    const bearings = photographs.map((one) => {
      const way = minus(one, place);
      return Math.atan2(dot(way, north), dot(way, east));
    });
    return widestGap(bearings) < Math.PI;
  });
}

/** The widest angle between neighbouring bearings, in radians. */
function widestGap(bearings: readonly number[]): number {
  const sorted = [...bearings].sort((a, b) => a - b);
  return sorted.reduce((widest, one, index) => {
    const next = sorted[index + 1] ?? (sorted[0] as number) + 2 * Math.PI;
    return Math.max(widest, next - one);
  }, 0);
}

/** At most `FLOWN` of the views, evenly from all of them. */
function spread<View>(views: readonly View[]): View[] {
  const step = Math.max(1, views.length / FLOWN);
  return views.filter((_, index) => Math.floor(index / step) !== Math.floor((index - 1) / step));
}

/** A position of a forecast, in the world frame. */
export function worldPosition(
  position: Schemas["FramePosition"] | Schemas["GeodeticPosition"],
  { frames }: Pick<Site, "frames">,
): Triple {
  if ("latitude_deg" in position) return frames.enu?.fromGeodetic(position) ?? [0, 0, 0];
  return position.frame === "model" ? frames.worldFromModel(position.position) : position.position;
}

function mean(values: readonly number[]): number {
  return values.reduce((sum, one) => sum + one, 0) / Math.max(1, values.length);
}

function median(places: readonly Triple[]): Triple {
  return [0, 1, 2].map((axis) => middle(places.map((place) => place[axis] as number))) as Triple;
}

function middle(values: readonly number[]): number {
  return [...values].sort((a, b) => a - b)[values.length >> 1] ?? 0;
}

function nearestDistance(place: Triple, others: readonly Triple[]): number {
  return others.reduce((least, one) => Math.min(least, length(minus(one, place))), Number.POSITIVE_INFINITY);
}

function nearest(places: readonly Triple[], to: Triple): Triple {
  return places.reduce(
    (best, place) => (length(minus(place, to)) < length(minus(best, to)) ? place : best),
    places[0] ?? to,
  );
}
