import type { PinholeIntrinsics, Triple } from "../api/artifacts";
import { roundLength } from "../components/format";
import { add, cross, dot, minus, times, unit } from "../geometry/vectors";
import type { Content, Marker } from "./content";
import { imageCorners } from "./lens";
import { across } from "./viewpoint";

/** A straight line from one point to another. */
export type Segment = readonly [Triple, Triple];

/** The edges of a marker: a frustum of depth `size` with its upper side marked, or a cross where it has no direction. */
export function edgesOf(marker: Marker, intrinsics: PinholeIntrinsics, size: number): Segment[] {
  const { position, orientation } = marker;
  if (!orientation) {
    const half = size / 3;
    return [0, 1, 2].map((axis) => {
      const arm = [0, 0, 0].map((_, at) => (at === axis ? half : 0)) as Triple;
      return [minus(position, arm), add(position, arm)] as const;
    });
  }
  const corners = imageCorners({ position, orientation }, intrinsics, size) as [
    Triple,
    Triple,
    Triple,
    Triple,
  ];
  const [a, b, c, d] = corners;
  const roof = add(times(add(a, b), 0.5), times(minus(a, d), 0.25));
  return [
    [position, a],
    [position, b],
    [position, c],
    [position, d],
    [a, b],
    [b, c],
    [c, d],
    [d, a],
    [a, roof],
    [roof, b],
  ];
}

/** The depth of frusta: they touch one another in a dense capture, and are no specks in a sparse one. */
export function frustumSize(content: Content): number {
  const places = content.markers.filter((one) => one.layer === "images" || one.layer === "unregistered");
  const some = places.filter((_, index) => index % Math.ceil(places.length / 100) === 0);
  const nearest = some.map((one) =>
    places.reduce((least, other) => {
      const away =
        other === one ? Number.POSITIVE_INFINITY : Math.hypot(...minus(other.position, one.position));
      return away > 0 ? Math.min(least, away) : least;
    }, Number.POSITIVE_INFINITY),
  );
  const median = nearest.sort((a, b) => a - b)[nearest.length >> 1] ?? Number.POSITIVE_INFINITY;
  return Math.max(content.radius * 0.01, Math.min(content.radius * 0.08, median * 0.45));
}

/** A grid on the ground, and how far apart its lines are. */
export interface Ground {
  spacing: number;
  lines: Segment[];
}

/** A grid below the model at a height along `up`; lines are 1, 2 or 5 times a power of ten apart, in metres if known. */
export function groundOf(content: Content, height: number): Ground {
  const { up, centre, radius } = content;
  const unitLength = content.metres ?? 1;
  const spacing = roundLength((radius * unitLength) / 5) / unitLength;
  const north = content.north ?? across(up);
  const y = unit(minus(north, times(up, dot(north, up))));
  const x = cross(y, up);
  const middle = add(centre, times(up, height - dot(centre, up)));
  const reach = Math.ceil(radius / spacing);
  const lines: Segment[] = [];
  for (let step = -reach; step <= reach; step++) {
    for (const [along, aside] of [
      [x, y],
      [y, x],
    ] as const) {
      const through = add(middle, times(aside, step * spacing));
      lines.push([add(through, times(along, -reach * spacing)), add(through, times(along, reach * spacing))]);
    }
  }
  return { spacing, lines };
}

/** The height along `up` above which nearly all points are. */
export function groundHeight(positions: Float32Array, up: Triple): number | null {
  const count = positions.length / 3;
  if (count === 0) return null;
  const step = Math.max(1, Math.floor(count / 5000));
  const heights: number[] = [];
  for (let point = 0; point < count; point += step) {
    const at = point * 3;
    heights.push(dot([positions[at] ?? 0, positions[at + 1] ?? 0, positions[at + 2] ?? 0], up));
  }
  heights.sort((a, b) => a - b);
  return heights[Math.floor(heights.length * 0.03)] as number;
}
