/** Coordinates on a plane: x to the right or east, y up or north. */
export type Flat = readonly [number, number];

/** The most corners of a polygon or line that the service takes. */
export const MOST_CORNERS = 200;

/** The area inside of a polygon that does not cross itself, in the square of its unit. */
export function areaOf(corners: readonly Flat[]): number {
  let double = 0;
  for (const [a, b] of edgesOf(corners)) double += a[0] * b[1] - b[0] * a[1];
  return Math.abs(double) / 2;
}

/** The length of a line through corners. */
export function lengthOf(corners: readonly Flat[]): number {
  let sum = 0;
  for (let i = 1; i < corners.length; i++) {
    const [a, b] = [corners[i - 1] as Flat, corners[i] as Flat];
    sum += Math.hypot(b[0] - a[0], b[1] - a[1]);
  }
  return sum;
}

/** Whether two edges of a polygon meet elsewhere than neighbours do at their corner. */
export function crossesItself(corners: readonly Flat[]): boolean {
  const edges = edgesOf(corners);
  return edges.some(([a, b], i) =>
    edges.slice(i + 1).some(([c, d], after) => {
      const neighbours = after === 0 || (i === 0 && after === edges.length - 2);
      if (!neighbours) return meet(a, b, c, d);
      const [tip, corner, other] = after === 0 ? [a, b, d] : [b, a, c];
      return side(corner, tip, other) === 0 && ahead(corner, tip, other) > 0; // it turns back on itself
    }),
  );
}

/** Whether a point is inside of a polygon. */
export function isInside([x, y]: Flat, corners: readonly Flat[]): boolean {
  let inside = false;
  for (const [a, b] of edgesOf(corners)) {
    const above = a[1] > y !== b[1] > y;
    if (above && x < a[0] + ((b[0] - a[0]) * (y - a[1])) / (b[1] - a[1])) inside = !inside;
  }
  return inside;
}

/** How far a point is from the segment between two others. */
export function distanceToSegment(point: Flat, a: Flat, b: Flat): number {
  const squared = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2;
  const share = squared === 0 ? 0 : Math.max(0, Math.min(1, ahead(a, b, point) / squared));
  return Math.hypot(a[0] + share * (b[0] - a[0]) - point[0], a[1] + share * (b[1] - a[1]) - point[1]);
}

function edgesOf(corners: readonly Flat[]): [Flat, Flat][] {
  return corners.map((corner, i) => [corner, corners[(i + 1) % corners.length] as Flat]);
}

function side(a: Flat, b: Flat, point: Flat): number {
  return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]);
}

function ahead(a: Flat, b: Flat, point: Flat): number {
  return (b[0] - a[0]) * (point[0] - a[0]) + (b[1] - a[1]) * (point[1] - a[1]);
}

function meet(a: Flat, b: Flat, c: Flat, d: Flat): boolean {
  const [ac, ad, ca, cb] = [side(a, b, c), side(a, b, d), side(c, d, a), side(c, d, b)];
  if (ac * ad < 0 && ca * cb < 0) return true;
  const touches = (s: number, p: Flat, q: Flat, point: Flat) =>
    s === 0 && ahead(p, q, point) >= 0 && ahead(q, p, point) >= 0;
  return touches(ac, a, b, c) || touches(ad, a, b, d) || touches(ca, c, d, a) || touches(cb, c, d, b);
}
