import type { Triple } from "../api/artifacts";
import type { Schemas } from "../api/service";
import type { Flat } from "./polygons";

type Volume = Schemas["RankingRequestOutput"]["no_fly"][number];

/** A volume from above: a polygon, or a line with a width to both sides. */
export interface Outline {
  corners: Flat[];
  /** How far it reaches from the line; null of a polygon. */
  radius: number | null;
}

/** What an upright volume covers on the map; `place` puts points of its frame there. Null where they have no place. */
export function outlineOf(volume: Volume, place: (point: Triple) => Triple | null): Outline | null {
  const flat = (points: Triple[]): Flat[] | null => {
    const placed = points.map(place);
    return placed.includes(null) ? null : (placed as Triple[]).map(([x, y]) => [x, y]);
  };
  const polygon = (points: Triple[]): Outline | null => {
    const corners = flat(points);
    return corners && { corners, radius: null };
  };
  switch (volume.kind) {
    case "prism":
      return polygon(volume.corners);
    case "box":
      return polygon(boxCorners(volume));
    case "cylinder":
      return polygon(circle(volume.base, volume.radius));
    case "shell":
      return polygon(circle(volume.centre, volume.outer));
    case "corridor": {
      const corners = flat(volume.path);
      return corners && { corners, radius: volume.radius };
    }
  }
}

/** Points around a level circle. */
export function circle([x, y, z]: Triple, radius: number, count = 64): Triple[] {
  return Array.from({ length: count }, (_, i): Triple => {
    const angle = (2 * Math.PI * i) / count;
    return [x + radius * Math.cos(angle), y + radius * Math.sin(angle), z];
  });
}

function boxCorners({ centre, size, along }: Schemas["BoxOutput"]): Triple[] {
  const [dx, dy] = along ?? [1, 0, 0];
  const level = Math.hypot(dx, dy) || 1;
  const [a, b] = [(dx / level) * 0.5, (dy / level) * 0.5];
  const [x, y, z] = centre;
  return [
    [-1, -1],
    [1, -1],
    [1, 1],
    [-1, 1],
  ].map(([i, j]): Triple => {
    const [first, second] = [(i as number) * size[0], (j as number) * size[1]];
    return [x + a * first - b * second, y + b * first + a * second, z];
  });
}
