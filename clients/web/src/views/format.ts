import type { Schemas } from "../api/service";
import { isGeodetic } from "../geometry/earth";
import { strings } from "../strings";

const { card } = strings.views;

/** A length with three digits, in metres or in the unit of the model. */
export function formatLength(length: number | null, metric: boolean): string {
  if (length === null) return strings.components.unknown;
  const text = fixed(length, 3);
  return metric ? strings.views.metres(text) : strings.views.units(text);
}

/** A number with so many digits, of which none are exponents. */
export function fixed(value: number, digits: number): string {
  const before = Math.floor(Math.log10(Math.max(Math.abs(value), 0.01))) + 1;
  return value.toFixed(Math.max(0, Math.min(digits, digits - before)));
}

/** A score, with as many digits as tell candidates apart. */
export function formatScore(score: number | null): string {
  return score === null ? strings.components.unknown : score.toFixed(3);
}

/** A share in whole percent. */
export function formatShare(share: number | null): string {
  return share === null ? strings.components.unknown : `${Math.round(share * 100)} %`;
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
