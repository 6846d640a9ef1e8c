import { expect, it } from "vitest";
import {
  formatAge,
  formatArea,
  formatBytes,
  formatDuration,
  formatLength,
  formatPercent,
  formatPose,
  roundLength,
  threeDigits,
} from "./format";

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

it("writes lengths and areas in the unit that fits", () => {
  expect([0.1234, 2, 12.345, 1234.5].map((length) => formatLength(length))).toEqual([
    "0.123 m",
    "2.00 m",
    "12.3 m",
    "1.23 km",
  ]);
  expect([formatLength(1234.5, false), formatLength(null)]).toEqual(["1235 units", "–"]);
  expect([250, 12_500, 2_500_000].map(formatArea)).toEqual(["250 m²", "1.25 ha", "2.50 km²"]);
  expect([9.996, -99.96].map(threeDigits)).toEqual(["10.0", "-100"]);
});

it("says above what altitudes are, and in what frame positions", () => {
  const place = {
    latitude_deg: 47.3977,
    longitude_deg: 8.5456,
    altitude_m: 480,
    altitude_datum: "sea-level" as const,
  };
  expect(formatPose({ ...place, yaw_deg: 90, pitch_deg: -45, roll_deg: 0 })).toEqual([
    "47.3977000, 8.5456000, 480.0 m (sea level)",
    "yaw 90.0°, pitch -45.0°",
  ]);
  const pose = { frame: "model" as const, position: [1, 2, 3] as [number, number, number] };
  expect(formatPose({ ...pose, orientation_wxyz: [1, 0, 0, 0] })[0]).toBe("model 1.000, 2.000, 3.000");
});

it.each([
  [4.9, 2],
  [5, 5],
  [0.013, 0.01],
  [730, 500],
])("%f m are rounded down to %f m", (length, round) => {
  expect(roundLength(length)).toBeCloseTo(round, 9);
});
