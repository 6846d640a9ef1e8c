import { expect, it } from "vitest";
import { formatAge, formatBytes, formatDuration, formatPercent } from "./format";

it("writes bytes with three digits", () => {
  expect([0, 999, 1000, 12_345, 999_600, 5_250_000_000].map(formatBytes)).toEqual([
    "0 B",
    "999 B",
    "1.00 kB",
    "12.3 kB",
    "1.00 MB",
    "5.25 GB",
  ]);
});

it("writes durations in the unit that fits", () => {
  expect([0.2, 59.4, 59.6, 3599, 3660].map(formatDuration)).toEqual([
    "0 s",
    "59 s",
    "1 min",
    "1 h 00 min",
    "1 h 01 min",
  ]);
});

it("says 100 % only at the end", () => {
  expect([0, 0.29, 0.9999, 1].map(formatPercent)).toEqual(["0 %", "29 %", "99 %", "100 %"]);
});

it("says how long ago a moment of today was", () => {
  const now = Date.parse("2026-05-01T12:00:00Z");
  expect(formatAge("2026-05-01T11:59:50Z", now)).toBe("just now");
  expect(formatAge("2026-05-01T11:15:00Z", now)).toBe("45 min ago");
  expect(formatAge("2026-05-01T09:00:00Z", now)).toBe("3 h ago");
  expect(formatAge("2026-04-01T09:00:00Z", now)).toContain("2026");
});
