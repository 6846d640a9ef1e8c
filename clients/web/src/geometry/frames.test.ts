import { describe, expect, it } from "vitest";
import type { Quaternion, Triple } from "../api/artifacts";
import { anglesOf, Enu, orientationOf } from "./earth";
import { Frames } from "./frames";
import { multiply, quaternionOf, rotate } from "./vectors";

const ORIGIN = { latitude_deg: 47.3977, longitude_deg: 8.5456, altitude_m: 480 };

function close(actual: readonly number[], expected: readonly number[], digits = 5): void {
  expect(actual.length).toBe(expected.length);
  actual.forEach((part, index) => {
    expect(part).toBeCloseTo(expected[index] as number, digits);
  });
}

describe("the ENU frame", () => {
  it("is that of pymap3d", () => {
    const place = { latitude_deg: 47.4005, longitude_deg: 8.5501, altitude_m: 512 };
    close(new Enu(ORIGIN).fromGeodetic(place), [339.7133347, 311.3349842, 31.9833626]);
    const south = new Enu({ latitude_deg: -33.9, longitude_deg: 151.2, altitude_m: 20 });
    const back = south.toGeodetic([1200, -800, 35]);
    expect(back.latitude_deg).toBeCloseTo(-33.9072116175, 9);
    expect(back.longitude_deg).toBeCloseTo(151.2129749489, 9);
    expect(back.altitude_m).toBeCloseTo(55.163118, 5);
  });
});

describe("a vehicle's attitude", () => {
  const cases: [number, number, number, Quaternion][] = [
    [130, -35, 12, [0.237818, -0.288782, 0.838685, -0.395796]],
    [10, -90, 0, [0, -0.996195, 0.087156, 0]],
    [270, 20, -30, [0.709406, -0.286788, -0.496732, 0.409576]],
  ];
  it.each(cases)("of %f %f %f is that of the service", (yaw_deg, pitch_deg, roll_deg, quaternion) => {
    const found = orientationOf({ yaw_deg, pitch_deg, roll_deg });
    const sign = found[0] * quaternion[0] + found[1] * quaternion[1] < 0 ? -1 : 1;
    close(
      found.map((part) => part * sign),
      quaternion,
    );
    const back = anglesOf(found);
    close([back.yaw_deg, back.pitch_deg, back.roll_deg], [yaw_deg, pitch_deg, roll_deg], 4);
  });
});

describe("the frames of a snapshot", () => {
  const quarter: Quaternion = [Math.SQRT1_2, 0, 0, Math.SQRT1_2];
  const frames = new Frames(
    {
      status: "aligned",
      source: "positions",
      scale: 2,
      rotation_wxyz: quarter,
      translation: [10, 0, 5],
      rms_m: 0.1,
      inliers: 9,
      positions: 9,
      takeoff_altitude_m: null,
    },
    ORIGIN,
  );

  it("are a similarity and its inverse", () => {
    close(frames.worldFromModel([1, 0, 0]), [10, 2, 5]);
    close(frames.modelFromWorld([10, 2, 5]), [1, 0, 0]);
  });

  it("turn a camera of the model into a vehicle's pose and back", () => {
    const camera = {
      position: [3, -1, 2] as Triple,
      orientation: multiply([Math.SQRT1_2, -Math.SQRT1_2, 0, 0], [0.96, 0, 0.28, 0]),
    };
    const vehicle = frames.vehicleOf(camera);
    const back = vehicle && frames.cameraInModel({ ...vehicle, altitude_datum: "sea-level" });
    if (!back) throw new Error("the scene is on Earth");
    close(back.position, camera.position);
    for (const axis of [
      [1, 0, 0],
      [0, 1, 0],
      [0, 0, 1],
    ] as Triple[]) {
      close(rotate(back.orientation, axis), rotate(camera.orientation, axis));
    }
  });

  it("have the world's z axis up, whichever way cameras are held, once they are aligned", () => {
    const tilted = { ...frames.alignment, rotation_wxyz: [Math.SQRT1_2, Math.SQRT1_2, 0, 0] as Quaternion };
    close(new Frames(tilted, ORIGIN).modelUp([1, 0, 0]), [0, 1, 0]);
    close(new Frames({ ...tilted, status: "model" }, null).modelUp([1, 0, 0]), [1, 0, 0]);
  });

  it("have no place on Earth without an origin", () => {
    const local = new Frames(frames.alignment, null);
    expect(local.geodeticFromModel([0, 0, 0])).toBeNull();
    expect(local.georeferenced).toBe(false);
  });
});

describe("quaternions of matrices", () => {
  it.each([
    [0.5, 0.5, 0.5, 0.5],
    [0, 1, 0, 0],
    [0, 0, 0.6, -0.8],
    [0.1, 0.1, 0.7, 0.7],
  ])("of %f %f %f %f turn as they do", (...quaternion) => {
    const turned = (axis: Triple) => rotate(quaternion as Quaternion, axis);
    const found = quaternionOf(turned([1, 0, 0]), turned([0, 1, 0]), turned([0, 0, 1]));
    close(rotate(found, [1, 2, 3]), turned([1, 2, 3]));
  });
});
