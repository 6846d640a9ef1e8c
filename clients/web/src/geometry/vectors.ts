import type { Quaternion, Triple } from "../api/artifacts";

export function add(a: Triple, b: Triple): Triple {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

export function minus(a: Triple, b: Triple): Triple {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

export function times(a: Triple, factor: number): Triple {
  return [a[0] * factor, a[1] * factor, a[2] * factor];
}

export function dot(a: Triple, b: Triple): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export function cross(a: Triple, b: Triple): Triple {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function length(a: Triple): number {
  return Math.hypot(...a);
}

export function unit(a: Triple): Triple {
  return times(a, 1 / length(a));
}

/** The rotation that applies `b` first, then `a`. */
export function multiply(a: Quaternion, b: Quaternion): Quaternion {
  const [w, x, y, z] = a;
  const [s, i, j, k] = b;
  return [
    w * s - x * i - y * j - z * k,
    w * i + x * s + y * k - z * j,
    w * j - x * k + y * s + z * i,
    w * k + x * j - y * i + z * s,
  ];
}

export function conjugate([w, x, y, z]: Quaternion): Quaternion {
  return [w, -x, -y, -z];
}

/** A vector rotated by a unit quaternion. */
export function rotate(by: Quaternion, vector: Triple): Triple {
  const axis: Triple = [by[1], by[2], by[3]];
  const twice = times(cross(axis, vector), 2);
  return add(add(vector, times(twice, by[0])), cross(axis, twice));
}

/** The unit quaternion of the rotation whose matrix has the columns `x`, `y` and `z`. */
export function quaternionOf(x: Triple, y: Triple, z: Triple): Quaternion {
  const trace = x[0] + y[1] + z[2];
  const squares = [1 + trace, 1 + x[0] - y[1] - z[2], 1 - x[0] + y[1] - z[2], 1 - x[0] - y[1] + z[2]];
  const largest = squares.indexOf(Math.max(...squares)) as 0 | 1 | 2 | 3;
  const double = 2 * Math.sqrt(squares[largest] as number);
  const parts: Quaternion[] = [
    [(double * double) / 4, y[2] - z[1], z[0] - x[2], x[1] - y[0]],
    [y[2] - z[1], (double * double) / 4, y[0] + x[1], z[0] + x[2]],
    [z[0] - x[2], y[0] + x[1], (double * double) / 4, z[1] + y[2]],
    [x[1] - y[0], z[0] + x[2], z[1] + y[2], (double * double) / 4],
  ];
  return (parts[largest] as Quaternion).map((part) => part / double) as Quaternion;
}
