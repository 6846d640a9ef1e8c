import { strings } from "../strings";

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
  const digits = unit === 0 || value >= 99.95 ? 0 : value >= 9.995 ? 1 : 2;
  return `${value.toFixed(digits)} ${units.bytes[unit]}`;
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
