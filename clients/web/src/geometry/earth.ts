import type { Quaternion, Triple } from "../api/artifacts";
import type { Schemas } from "../api/service";
import { add, cross, minus, quaternionOf, rotate } from "./vectors";

/** A place on Earth: degrees on WGS 84, and metres above the datum of the scene's altitudes. */
export interface Geodetic {
  latitude_deg: number;
  longitude_deg: number;
  altitude_m: number;
}

const RADIUS_M = 6378137;
const FLATTENING = 1 / 298.257223563;
const ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING);

const radians = (degrees: number) => (degrees * Math.PI) / 180;
const degrees = (angle: number) => (angle * 180) / Math.PI;

/**
 * The ENU frame of an origin: x east, y north, z up, in metres.
 *
 * Altitudes keep their datum: within a scene, the difference between datums is the same everywhere.
 */
export class Enu {
  private readonly centre: Triple;

  constructor(readonly origin: Geodetic) {
    this.centre = ecef(origin);
  }

  fromGeodetic(place: Geodetic): Triple {
    const [x, y, z] = minus(ecef(place), this.centre);
    const [sinLat, cosLat, sinLon, cosLon] = this.angles();
    return [
      -sinLon * x + cosLon * y,
      -sinLat * cosLon * x - sinLat * sinLon * y + cosLat * z,
      cosLat * cosLon * x + cosLat * sinLon * y + sinLat * z,
    ];
  }

  toGeodetic([east, north, up]: Triple): Geodetic {
    const [sinLat, cosLat, sinLon, cosLon] = this.angles();
    return geodetic(
      add(this.centre, [
        -sinLon * east - sinLat * cosLon * north + cosLat * cosLon * up,
        cosLon * east - sinLat * sinLon * north + cosLat * sinLon * up,
        cosLat * north + sinLat * up,
      ]),
    );
  }

  private angles(): [number, number, number, number] {
    const latitude = radians(this.origin.latitude_deg);
    const longitude = radians(this.origin.longitude_deg);
    return [Math.sin(latitude), Math.cos(latitude), Math.sin(longitude), Math.cos(longitude)];
  }
}

/**
 * Orientation of a vehicle's camera in the world, a quaternion world_from_camera (OpenCV camera, ENU world).
 *
 * Yaw is clockwise from north, pitch up, roll with the right side down.
 */
export function orientationOf(pose: { yaw_deg: number; pitch_deg: number; roll_deg?: number }): Quaternion {
  const yaw = radians(pose.yaw_deg);
  const pitch = radians(pose.pitch_deg);
  const roll = radians(pose.roll_deg ?? 0);
  const forward: Triple = [Math.sin(yaw) * Math.cos(pitch), Math.cos(yaw) * Math.cos(pitch), Math.sin(pitch)];
  const level: Triple = [Math.cos(yaw), -Math.sin(yaw), 0];
  const down = cross(forward, level);
  const turned = (a: Triple, b: Triple, sine: number): Triple =>
    add(a.map((part) => part * Math.cos(roll)) as Triple, b.map((part) => part * sine) as Triple);
  return quaternionOf(turned(level, down, Math.sin(roll)), turned(down, level, -Math.sin(roll)), forward);
}

/** Angles of a vehicle whose camera has an orientation world_from_camera; the inverse of `orientationOf`. */
export function anglesOf(orientation: Quaternion): { yaw_deg: number; pitch_deg: number; roll_deg: number } {
  const forward = rotate(orientation, [0, 0, 1]);
  const right = rotate(orientation, [1, 0, 0]);
  const down = rotate(orientation, [0, 1, 0]);
  const vertical = Math.hypot(forward[0], forward[1]) < 1e-6;
  const yaw = vertical ? Math.atan2(-right[1], right[0]) : Math.atan2(forward[0], forward[1]);
  const roll = vertical ? 0 : Math.atan2(-right[2], -down[2]);
  return {
    yaw_deg: (degrees(yaw) + 360) % 360,
    pitch_deg: degrees(Math.asin(Math.max(-1, Math.min(1, forward[2])))),
    roll_deg: degrees(roll),
  };
}

/** Whether a pose is a vehicle's, with a place on Earth. */
export function isGeodetic(
  pose: Schemas["FramePose"] | Schemas["VehiclePose"],
): pose is Schemas["VehiclePose"] {
  return "latitude_deg" in pose;
}

function ecef({ latitude_deg, longitude_deg, altitude_m }: Geodetic): Triple {
  const latitude = radians(latitude_deg);
  const longitude = radians(longitude_deg);
  const curvature = RADIUS_M / Math.sqrt(1 - ECCENTRICITY_2 * Math.sin(latitude) ** 2);
  return [
    (curvature + altitude_m) * Math.cos(latitude) * Math.cos(longitude),
    (curvature + altitude_m) * Math.cos(latitude) * Math.sin(longitude),
    (curvature * (1 - ECCENTRICITY_2) + altitude_m) * Math.sin(latitude),
  ];
}

/** The inverse of `ecef`, by iteration: below 1e-6 m near the surface. */
function geodetic([x, y, z]: Triple): Geodetic {
  const level = Math.hypot(x, y);
  let latitude = Math.atan2(z, level * (1 - ECCENTRICITY_2));
  let curvature = RADIUS_M;
  for (let round = 0; round < 6; round++) {
    curvature = RADIUS_M / Math.sqrt(1 - ECCENTRICITY_2 * Math.sin(latitude) ** 2);
    latitude = Math.atan2(z + ECCENTRICITY_2 * curvature * Math.sin(latitude), level);
  }
  const altitude_m =
    level * Math.cos(latitude) +
    z * Math.sin(latitude) -
    RADIUS_M * Math.sqrt(1 - ECCENTRICITY_2 * Math.sin(latitude) ** 2);
  return { latitude_deg: degrees(latitude), longitude_deg: degrees(Math.atan2(y, x)), altitude_m };
}
