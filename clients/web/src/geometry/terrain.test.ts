import { expect, it } from "vitest";
import { heightIn } from "./terrain";

const TERRAIN = {
  kind: "heights" as const,
  south_deg: 46,
  west_deg: 7,
  latitude_step_deg: 0.1,
  longitude_step_deg: 0.1,
  columns: 3,
  heights_m: [100, 200, 300, 300, 400, -32768],
};
const at = (latitude_deg: number, longitude_deg: number) =>
  heightIn(TERRAIN, { latitude_deg, longitude_deg });

it("The ground is between the heights around a place, where all are known", () => {
  expect(at(46, 7)).toBeCloseTo(100, 6);
  expect(at(46.05, 7.05)).toBeCloseTo(250, 6);
  expect(at(46.05, 7.15)).toBeNull();
  expect(at(47, 7)).toBeNull();
  expect(at(46.05, 6.95)).toBeNull();
});
