import type { Schemas } from "../api/service";
import { isGeodetic } from "../geometry/earth";
import { strings } from "../strings";

const { card } = strings.views;
const { units, ago, unknown } = strings.components;
const LOCALE = "en-GB";
const DATE = new Intl.DateTimeFormat(LOCALE, { dateStyle: "medium", timeStyle: "short" });

/** A number of bytes in powers of 1000, with three digits. */
export function formatBytes(bytes: number): string {
  let value = bytes;
  let unit = 0;
  while (value >= 999.5 && unit < units.bytes.length - 1) {
    value /= 1000;
    unit++;
  }
  return `${unit === 0 ? Math.round(value) : threeDigits(value)} ${units.bytes[unit]}`;
}

/** A number with three digits, without exponents. */
export function threeDigits(value: number): string {
  const size = Math.abs(value);
  return value.toFixed(size >= 99.95 ? 0 : size >= 9.995 ? 1 : size >= 0.9995 ? 2 : 3);
}

/** The greatest of 1, 2 and 5 times powers of ten that is not above a length. */
export function roundLength(length: number): number {
  const power = 10 ** Math.floor(Math.log10(length));
  const step = length / power;
  return power * (step >= 5 ? 5 : step >= 2 ? 2 : 1);
}

/** A length in metres or kilometres, or in the unit of a model; a dash where there is none. */
export function formatLength(length: number | null, metric = true): string {
  if (length === null) return unknown;
  if (!metric) return units.ofModel(threeDigits(length));
  return Math.abs(length) < 999.5
    ? units.metres(threeDigits(length))
    : units.kilometres(threeDigits(length / 1000));
}

/** An area in m² as square metres, hectares or square kilometres. */
export function formatArea(area: number): string {
  if (area < 10_000) return units.squareMetres(threeDigits(area));
  if (area < 1_000_000) return units.hectares(threeDigits(area / 10_000));
  return units.squareKilometres(threeDigits(area / 1_000_000));
}

/** A count with separators of thousands. */
export function formatCount(count: number): string {
  return count.toLocaleString("en-US");
}

/** A duration in s as seconds, minutes, or hours and minutes. */
export function formatDuration(seconds: number): string {
  if (seconds < 59.5) return units.seconds(Math.max(0, Math.round(seconds)));
  const minutes = Math.round(seconds / 60);
  if (minutes < 60) return units.minutes(minutes);
  return units.hours(Math.floor(minutes / 60), minutes % 60);
}

/** A level in dB with one digit after the point; a dash when there is none. */
export function formatDecibels(level: number | null): string {
  return level === null ? unknown : units.decibels(level.toFixed(1));
}

/** A share from 0 to 1 in whole percent, which reaches 100 only at the end. */
export function formatPercent(share: number): string {
  return units.percent(Math.floor(share * 100 + 1e-9));
}

/** A share from 0 to 1, rounded to whole percent; a dash where there is none. */
export function formatShare(share: number | null): string {
  return share === null ? unknown : units.percent(Math.round(share * 100));
}

/** A score, with as many digits as tell candidates apart; a dash where there is none. */
export function formatScore(score: number | null): string {
  return score === null ? unknown : score.toFixed(3);
}

/** A moment with date and time, in the time zone of the browser. */
export function formatDate(iso: string): string {
  return DATE.format(new Date(iso));
}

/** How long ago a moment was, and its date when that is more than a day. */
export function formatAge(iso: string, now: number = Date.now()): string {
  const minutes = Math.floor((now - new Date(iso).getTime()) / 60_000);
  if (minutes < 1) return ago.now;
  if (minutes < 60) return ago.minutes(minutes);
  if (minutes < 24 * 60) return ago.hours(Math.floor(minutes / 60));
  return formatDate(iso);
}

/** A pose in lines: where it is, and where it looks. */
export function formatPose(pose: Schemas["FramePoseOutput"] | Schemas["VehiclePoseOutput"]): string[] {
  if (isGeodetic(pose)) {
    const { latitude_deg, longitude_deg, altitude_m, altitude_datum, yaw_deg, pitch_deg } = pose;
    const datum = card.datums[altitude_datum ?? "sea-level"];
    return [
      card.geodetic(latitude_deg.toFixed(7), longitude_deg.toFixed(7), altitude_m.toFixed(1), datum),
      card.angles(yaw_deg.toFixed(1), pitch_deg.toFixed(1)),
    ];
  }
  const [x, y, z] = pose.position.map((part) => part.toFixed(3)) as [string, string, string];
  return [
    card.position(pose.frame ?? "world", x, y, z),
    card.quaternion(pose.orientation_wxyz.map((part) => part.toFixed(4)).join(" ")),
  ];
}
