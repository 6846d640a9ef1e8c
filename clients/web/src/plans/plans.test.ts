import { describe, expect, it, vi } from "vitest";
import type { Schemas } from "../api/service";
import { allLeftOut, fileName, leftOutOf, missionParts, routeOf } from "./mission-files";
import { MISSION, type MissionForm, missionCall, missionQuery, objection } from "./mission-form";

const PLAN = {
  id: "pln_1",
  snapshot_id: "snp_1",
  tours: [{ vehicle: 2, stops: [{ id: "a", pose: {}, via: [] }], via_home: [{ x: 1 }] }],
} as unknown as Schemas["Plan"];
const RANKING = {
  id: "rnk_1",
  snapshot_id: "snp_1",
  candidates: [
    { id: "a", rank: 1, pose: {} },
    { id: "b", rank: 2, pose: {} },
    { id: "c", rank: null, pose: {} },
  ],
} as unknown as Schemas["Ranking"];
const MATERIAL = { sceneId: "scn_1", ranking: RANKING, plan: PLAN, drawings: [] };
const HOME = { home: true, latitude: "46.02", longitude: "7.75", altitude: "1605" };

function form(change: Partial<MissionForm>): MissionForm {
  return { ...MISSION, ...change };
}

describe("the request of a mission", () => {
  it("has what was said, and the part", () => {
    const query = missionQuery(form({ ...HOME, battery: "25", source: "ranking" }), [], 2);
    expect(Object.fromEntries(query)).toEqual({
      format: "qgc-plan",
      first: "8",
      leave_out: "true",
      home_latitude_deg: "46.02",
      home_longitude_deg: "7.75",
      home_altitude_m: "1605",
      speed_m_s: "5",
      hold_s: "4",
      battery_s: "1500",
      battery_reserve: "0.3",
      finish: "return",
      autopilot: "ardupilot",
      part: "2",
    });
  });

  it("of MAVSDK is for PX4", () => {
    const query = missionQuery(form({ format: "mavsdk", autopilot: "ardupilot" }), [], 1);
    expect(query.get("autopilot")).toBe("px4");
    expect(missionQuery(form({ battery: "" }), [], 1).has("battery_reserve")).toBe(false);
  });

  it("has home above the photographs' takeoff instead of its altitude", () => {
    const query = missionQuery(form({ ...HOME, aboveTakeoff: "0" }), [], 1);
    expect([query.get("home_above_takeoff_m"), query.get("home_altitude_m")]).toEqual(["0", null]);
  });

  it("of a robot has neither home nor heights", () => {
    const query = missionQuery(form({ ...HOME, format: "ros-posearray", leaveOut: false }), [], 1);
    expect(Object.fromEntries(query)).toEqual({ format: "ros-posearray" });
  });

  it("is that of the ranking or of the plan's vehicle", () => {
    expect(missionCall(form({ source: "ranking" }), MATERIAL, 1)).toMatchObject({
      path: expect.stringContaining("/v1/rankings/rnk_1/mission?format=qgc-plan&first=8"),
      body: null,
    });
    expect(missionCall(form({ vehicle: "2" }), MATERIAL, 1).path).toContain("/v1/plans/pln_1/mission?");
    expect(missionCall(form({ vehicle: "2" }), MATERIAL, 1).path).toContain("vehicle=2");
  });

  it("carries its views when the ground matters, and may be all photographs again", () => {
    const over = missionCall(form({ source: "ranking", first: "1", terrain: true }), MATERIAL, 1);
    expect(over.path).toMatch(/^\/v1\/scenes\/scn_1\/missions\?/);
    expect(over.path).not.toContain("first=");
    expect(over.body).toEqual({
      views: [{ id: "a", pose: {} }],
      snapshot_id: "snp_1",
      terrain: { kind: "points" },
    });
    const tour = missionCall(form({ vehicle: "2", terrain: true }), MATERIAL, 1);
    expect(tour.body).toMatchObject({ via_home: [{ x: 1 }] });
    expect(missionCall(form({ source: "photographs" }), MATERIAL, 1).body).toEqual({ all_images: true });
  });

  it("says what is missing", () => {
    expect(() => missionCall(form({}), { ...MATERIAL, plan: null }, 1)).toThrow("Show a plan");
    expect(() => missionQuery(form({ home: true }), [], 1)).toThrow("home");
  });
});

describe("the files of a plan", () => {
  it("are those of each vehicle that flies, with its number in their names", async () => {
    const tour = (vehicle: number, stops: unknown[]) => ({ vehicle, stops, via_home: [] });
    const plan = { id: "pln_1", tours: [tour(1, [{}]), tour(2, []), tour(3, [{}])] };
    const asked: string[] = [];
    vi.stubGlobal("fetch", async (request: Request) => {
      asked.push(new URL(request.url).searchParams.get("vehicle") ?? "");
      const headers = {
        "Content-Disposition": 'attachment; filename="m.json"',
        "Left-Out": `x${asked.length}`,
      };
      return new Response("{}", { headers });
    });
    const material = { ...MATERIAL, plan: plan as unknown as Schemas["Plan"] };
    const files = await missionParts(
      form({ format: "ros-posearray" }),
      material,
      new AbortController().signal,
    );
    vi.unstubAllGlobals();
    expect(asked).toEqual(["1", "3"]);
    expect(files.map(({ name }) => name)).toEqual(["vehicle-1-m.json", "vehicle-3-m.json"]);
    expect(allLeftOut([...files, ...files]).map(({ id }) => id)).toEqual(["x1", "x2"]);
  });
});

it("Formats that need Earth say so", () => {
  expect(objection("qgc-plan", false, true)).toContain("Earth");
  expect(objection("ros-posearray", false, true)).toBeNull();
  expect(objection("ros-posearray", false, false)).toContain("metres");
  expect(objection("nerfstudio", false, false)).toBeNull();
});

describe("a file", () => {
  it("has the name, the left-out views and the reasons of its headers", () => {
    expect(fileName('attachment; filename="pln_1-1-of-3.plan"')).toBe("pln_1-1-of-3.plan");
    const headers = new Headers({ "Left-Out": "a,b", "Left-Out-Reasons": '["it is under ground"]' });
    expect(leftOutOf(headers)).toEqual([
      { id: "a", reason: "it is under ground" },
      { id: "b", reason: "" },
    ]);
    expect(leftOutOf(new Headers())).toEqual([]);
  });

  it("has a route with its views, its length and its time, if it is flown", () => {
    const headers = { "Mission-Views": "2", "Mission-Length-M": "252.7", "Mission-Duration-S": "131.5" };
    expect(routeOf(new Headers(headers))).toEqual({ views: 2, length_m: 252.7, duration_s: 131.5 });
    expect(routeOf(new Headers({ "Mission-Views": "2" }))).toBeNull();
  });
});
