import { signal } from "@preact/signals";
import { describe, expect, it } from "vitest";
import type { Quaternion, SnapshotCameras, Triple } from "../api/artifacts";
import type { Schemas } from "../api/service";
import { Enu } from "../geometry/earth";
import { Frames } from "../geometry/frames";
import type { SceneStore } from "../store/scene";
import { contentOf, sphereOf } from "./content";
import { forecastOf } from "./forecast";

const ORIGIN = { latitude_deg: 47, longitude_deg: 8, altitude_m: 400, altitude_datum: "sea-level" as const };
const EAST = new Enu(ORIGIN).toGeodetic([10, 0, 20]);
const QUARTER: Quaternion = [Math.SQRT1_2, 0, 0, Math.SQRT1_2];

/** A model whose unit is 2 m and whose x axis points north. */
function alignment(status: "aligned" | "model"): Schemas["Alignment"] {
  const aligned = status === "aligned";
  return {
    status,
    source: "positions",
    scale: aligned ? 2 : 1,
    rotation_wxyz: aligned ? QUARTER : [1, 0, 0, 0],
    translation: [0, 0, 0],
    rms_m: null,
    inliers: 0,
    positions: 0,
    takeoff_altitude_m: null,
  };
}

const CAMERAS: SnapshotCameras = {
  camera: { width_px: 640, height_px: 480, fx_px: 400, fy_px: 400, cx_px: 320, cy_px: 240 },
  views: [
    { image: "a", name: "a.jpg", position: [1, 2, 3], orientation_wxyz: [1, 0, 0, 0], counted_share: 1 },
  ],
  centre: [0, 0, 0],
  up: [0, 0, 1],
  lower: [-1, -1, -1],
  upper: [1, 1, 1],
};

function image(digest: string, place: Partial<Schemas["Prior"]> | null): Schemas["Image"] {
  const prior = place && { source: "request", latitude_deg: null, x_m: null, yaw_deg: null, ...place };
  return {
    digest,
    name: `${digest}.jpg`,
    verdict: "accepted",
    registration: "pending",
    prior,
  } as Schemas["Image"];
}

function store(model: "aligned" | "model" | null, images: Schemas["Image"][] = []): SceneStore {
  const snapshot = model && { id: "new", alignment: alignment(model) };
  return {
    scene: signal({ origin: ORIGIN }),
    snapshot: signal(snapshot),
    frames: signal(snapshot && new Frames(snapshot.alignment, ORIGIN)),
    cameras: signal(model && CAMERAS),
    images: signal(images),
    ranking: signal(null),
    plan: signal(null),
    visits: signal([]),
    forecast: signal(null),
  } as unknown as SceneStore;
}

function close(actual: readonly number[] | undefined, expected: readonly number[]): void {
  expect(actual).toHaveLength(expected.length);
  expected.forEach((part, index) => {
    expect(actual?.[index]).toBeCloseTo(part, 4);
  });
}

const pose = (position: Triple) => ({ frame: "model" as const, position, orientation_wxyz: [1, 0, 0, 0] });

describe("what the 3D view shows", () => {
  it("is the positions of photographs before there is a model", () => {
    const { markers, north, up } = contentOf(store(null, [image("a", EAST), image("b", null)]));
    expect(markers.map((marker) => marker.layer)).toEqual(["unregistered"]);
    close(markers[0]?.position, [10, 0, 20]);
    expect(markers[0]?.orientation).toBeNull();
    expect([north, up]).toEqual([
      [0, 1, 0],
      [0, 0, 1],
    ]);
  });

  it("is also photographs without a pose, where their positions put them in the model", () => {
    const images = [image("a", EAST), image("b", { ...EAST, yaw_deg: 90 })];
    const content = contentOf(store("aligned", images));
    const [registered, other] = content.markers;
    expect([registered?.paint.kind, other?.paint.kind]).toEqual(["registered", "unregistered"]);
    close(other?.position, [0, -5, 10]);
    expect(other?.orientation).not.toBeNull();
    close(content.north ?? [], [1, 0, 0]);
    expect(content.metres).toBe(2);
    expect(contentOf(store("model", images)).markers).toHaveLength(1);
  });

  it("is candidates by rank; those of another model come through the world", () => {
    const shown = store("aligned");
    const candidates = [
      { id: "best", rank: 1, status: "ranked", pose: pose([1, 0, 0]) },
      { id: "last", rank: 3, status: "ranked", pose: pose([0, 0, 0]) },
      { id: "out", rank: null, status: "no-fly", pose: pose([0, 0, 0]) },
    ];
    const ranking = { snapshot_id: "new", alignment: alignment("aligned"), origin: ORIGIN, candidates };
    shown.ranking.value = ranking as unknown as Schemas["Ranking"];
    const markers = contentOf(shown).markers.slice(1);
    expect(markers.map((marker) => marker.paint)).toEqual([
      { kind: "rank", value: 0 },
      { kind: "rank", value: 1 },
      { kind: "unranked" },
    ]);
    close(markers[0]?.position, [1, 0, 0]);
    const older = { ...ranking, snapshot_id: "old", alignment: { ...alignment("aligned"), scale: 4 } };
    shown.ranking.value = older as unknown as Schemas["Ranking"];
    close(contentOf(shown).markers[1]?.position, [2, 0, 0]);
  });

  it("is the way of each vehicle from where it is, by what it passes, and home", () => {
    const shown = store("aligned");
    const plan = {
      snapshot_id: "new",
      alignment: alignment("aligned"),
      origin: ORIGIN,
      request: { vehicles: [pose([0, 0, 0])], home: true },
      tours: [
        {
          vehicle: 1,
          stops: [{ id: "s", pose: pose([2, 0, 0]), via: [pose([1, 1, 0])] }],
          via_home: [pose([1, -1, 0])],
        },
        { vehicle: 2, stops: [], via_home: [] },
      ],
    };
    shown.plan.value = plan as unknown as Schemas["Plan"];
    const { routes, markers } = contentOf(shown);
    expect(routes).toHaveLength(1);
    expect(routes[0]?.way).toEqual([
      [0, 0, 0],
      [1, 1, 0],
      [2, 0, 0],
      [1, -1, 0],
      [0, 0, 0],
    ]);
    expect(routes[0]?.stops).toEqual([{ number: 1, position: [2, 0, 0] }]);
    expect(markers.at(-1)?.selects).toEqual({ kind: "stop", id: "s" });
  });
});

describe("a forecast in the view", () => {
  const samples = [
    {
      id: "surface-1",
      pose: null,
      position: { frame: "model", position: [1, 0, 0] },
      variance: 0.2,
      psnr_db: 30,
    },
    { id: "surface-2", pose: null, position: EAST, variance: 0.8, psnr_db: 20 },
  ];

  it.each([
    [false, "variance", [0.8, 0.2]],
    [true, "dB", [20, 30]],
  ] as const)("colours first what is least known (calibrated: %s)", (calibrated, unit, ends) => {
    const shown = store("aligned");
    const forecast = {
      snapshot_id: "new",
      alignment: alignment("aligned"),
      origin: ORIGIN,
      calibrated,
      samples,
    };
    shown.forecast.value = forecast as unknown as Schemas["Forecast"];
    const found = forecastOf(shown);
    expect([found?.unit, found?.ends]).toEqual([unit, ends]);
    close(
      found?.samples.map((sample) => sample.value),
      [1, 0],
    );
    close(found?.samples[1]?.position, [0, -5, 10]);
  });
});

describe("the sphere around points", () => {
  it("has a radius also around none and one", () => {
    expect(sphereOf([]).radius).toBe(1);
    expect(sphereOf([[5, 5, 5]])).toEqual({ centre: [5, 5, 5], radius: 1 });
    close(
      [
        sphereOf([
          [0, 0, 0],
          [2, 4, 4],
        ]).radius,
      ],
      [3],
    );
  });
});
