import { describe, expect, it } from "vitest";
import type { SnapshotCameras } from "../api/artifacts";
import type { Schemas } from "../api/service";
import { CANDIDATES, expectedOf, generatorOf } from "../candidates/candidates-form";
import { boxAround, lastImage, type Site } from "../candidates/site";
import { Frames } from "../geometry/frames";
import type { Drawing } from "../store/scene";
import { leastKnown, summaryOf } from "./forecast-form";
import { sorted } from "./order";
import { RANKING, rankingRequest } from "./ranking-form";

const ORIGIN = {
  latitude_deg: 47.3977,
  longitude_deg: 8.5456,
  altitude_m: 480,
  altitude_datum: "sea-level" as const,
};
const AREA: Drawing = {
  id: "a",
  use: "area",
  corners: [
    { latitude_deg: 47.3977, longitude_deg: 8.5456 },
    { latitude_deg: 47.3987, longitude_deg: 8.5456 },
    { latitude_deg: 47.3987, longitude_deg: 8.5476 },
  ],
  radius_m: 10,
  lower_m: 20,
  upper_m: 40,
};
const CAMERAS = {
  centre: [0, 0, 0],
  up: [0, 0, 1],
  lower: [-2, -1, 0],
  upper: [2, 1, 1],
  views: ["first", "second"].map((image, index) => ({
    image,
    name: `${image}.jpg`,
    position: [4 * index, 0, 3],
    orientation_wxyz: [0, 1, 0, 0],
    counted_share: 1,
  })),
} as unknown as SnapshotCameras;

function siteWith(drawings: Drawing[], earth = true): Site {
  const alignment: Schemas["Alignment"] = {
    status: earth ? "aligned" : "model",
    source: "positions",
    scale: earth ? 2 : 1,
    rotation_wxyz: [1, 0, 0, 0],
    translation: [0, 0, 0],
    rms_m: 0.1,
    inliers: 2,
    positions: 2,
    takeoff_altitude_m: null,
  };
  const image = (number: number, captured_at: string) => ({ number, captured_at }) as Schemas["Image"];
  return {
    frames: new Frames(alignment, earth ? ORIGIN : null),
    cameras: CAMERAS,
    images: new Map([
      ["first", image(1, "2026-05-02T10:00:00Z")],
      ["second", image(2, "2026-05-01T10:00:00Z")],
    ]),
    drawings,
    origin: earth ? ORIGIN : null,
    selected: null,
  };
}

describe("a ranking's request", () => {
  it("measures from the photograph that was taken last, and leaves empty fields to the service", () => {
    expect(lastImage(siteWith([]))).toBe("first");
    expect(rankingRequest(RANKING, siteWith([]), null)).toEqual({
      method: "median-frequency",
      generator: { kind: "orbit" },
      current_pose: { frame: "model", position: [0, 0, 3], orientation_wxyz: [0, 1, 0, 0] },
      frame: "geodetic",
    });
  });

  it("has the photographs to take for methods that plan, and a radius around the camera", () => {
    const candidates = { ...CANDIDATES, source: "around-current" as const, count: "12" };
    const request = rankingRequest(
      { ...RANKING, method: "kriging", candidates },
      siteWith([], false),
      "snp_1",
    );
    expect(request).toMatchObject({ budget: 8, frame: "world", snapshot_id: "snp_1" });
    expect(request.generator).toEqual({ kind: "around-current", count: 12 });
    expect(request.radius_m).toBeGreaterThan(0);
    expect(expectedOf({ kind: "grid", columns: 4 })).toBe(24);
  });

  it("starts at a place on the map as high as the last photograph, and keeps out of drawn zones", () => {
    const place = { latitude_deg: 47.4, longitude_deg: 8.55 };
    const zone = { ...AREA, id: "z", use: "no-fly" as const };
    const request = rankingRequest({ ...RANKING, start: "place", place }, siteWith([zone]), null);
    expect(request.no_fly).toHaveLength(1);
    expect(request.current_pose).toMatchObject({ ...place, altitude_datum: "sea-level" });
    expect((request.current_pose as Schemas["VehiclePose"]).altitude_m).toBeCloseTo(486, 3);
  });

  it("says what is missing", () => {
    const candidates = { ...CANDIDATES, source: "drawing" as const };
    expect(() => rankingRequest({ ...RANKING, candidates }, siteWith([]), null)).toThrow("Draw an area");
    expect(() => rankingRequest({ ...RANKING, start: "selected" }, siteWith([]), null)).toThrow("Select");
  });
});

describe("volumes of candidates", () => {
  it("are drawn areas", () => {
    const form = { ...CANDIDATES, source: "drawing" as const, look: "nearest" as const };
    expect(generatorOf(form, siteWith([AREA]))).toMatchObject({
      kind: "in-volume",
      look: "nearest",
      count: 100,
      volume: { kind: "prism", lower: 20, upper: 40 },
    });
  });

  it("hold the model and its photographs, in the world's unit", () => {
    const { centre, size } = boxAround(siteWith([]), 0);
    expect(centre).toEqual([2, 0, 3]);
    expect(size).toEqual([12, 4, 6]);
  });
});

it("Candidates without a value come last, whatever the order", () => {
  const candidates = [
    { id: "c10", rank: null, score: null },
    { id: "c2", rank: 1, score: -2 },
    { id: "c1", rank: 2, score: -1 },
  ] as Schemas["RankedCandidate"][];
  const ids = (column: "score" | "id", descending: boolean) =>
    sorted(candidates, { column, descending }).map(({ id }) => id);
  expect(ids("score", false)).toEqual(["c2", "c1", "c10"]);
  expect(ids("score", true)).toEqual(["c1", "c2", "c10"]);
  expect(ids("id", false)).toEqual(["c1", "c2", "c10"]);
});

describe("a forecast", () => {
  const sample = (id: string, variance: number, psnr_db: number | null) => ({
    id,
    variance,
    psnr_db,
    low_db: null,
    high_db: null,
    pose: null,
    position: { frame: "world" as const, position: [variance, 0, 0] as [number, number, number] },
  });
  const forecast = (samples: ReturnType<typeof sample>[], calibrated: boolean) =>
    ({ samples, calibrated }) as unknown as Schemas["Forecast"];

  it("is summed up in variances, and in dB once it is calibrated", () => {
    const samples = [sample("a", 0.2, 30), sample("b", 0.8, 20)];
    const { samples: count, mean, most, unknown, psnr } = summaryOf(forecast(samples, true));
    expect([count, mean, most, unknown]).toEqual([2, 0.5, 0.8, 0.5]);
    expect(psnr).toEqual({ mean: 25, least: 20 });
    expect(summaryOf(forecast(samples, false)).psnr).toBeNull();
  });

  it("is flown where its variance is highest: around the surface, or at the candidates", () => {
    const surface = forecast([sample("a", 0.1, null), sample("b", 0.9, null)], false);
    expect(leastKnown("surface", surface, siteWith([]))).toMatchObject({
      generator: { kind: "in-volume", aim: [0.9, 0, 0], volume: { kind: "shell", centre: [0.9, 0, 0] } },
    });
    const pose = { frame: "world" as const, position: [0, 0, 1], orientation_wxyz: [0, 1, 0, 0] };
    const poses = forecast([{ ...sample("a", 0.1, null), pose: pose as never }], false);
    expect(leastKnown("candidates", poses, siteWith([]))).toEqual({ candidates: [{ id: "a", pose }] });
  });

  it("is flown over the ground where photographs surround it, not where nothing was photographed", () => {
    const site = siteWith([]);
    const corners = [[0, 0, 3], [4, 0, 3], [4, 4, 3], [0, 4, 3]]; // biome-ignore format: a square
    const views = corners.map((position, index) => ({ ...CAMERAS.views[0], image: `${index}`, position }));
    const over = (id: string, x: number, y: number, variance: number) => {
      const pose = { frame: "world", position: [x, y, 6], orientation_wxyz: [0, 1, 0, 0] };
      return { ...sample(id, variance, null), pose: pose as never };
    };
    const samples = [over("outside", 40, 4, 0.9), over("gap", 4, 4, 0.5), over("edge", 4, -3, 0.4)];
    const cameras = { ...CAMERAS, views } as SnapshotCameras;
    const { candidates } = leastKnown("ground", forecast(samples, false), { ...site, cameras }) as {
      candidates: { id: string }[];
    };
    expect(candidates.map(({ id }) => id)).toEqual(["gap"]);
  });
});
