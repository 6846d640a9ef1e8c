import { describe, expect, it } from "vitest";
import type { Quaternion, Triple } from "../api/artifacts";
import { dot, length, minus, rotate } from "../geometry/vectors";
import {
  between,
  forwardOf,
  framing,
  fromAbove,
  lookAt,
  move,
  orbit,
  targetOf,
  turn,
  zoom,
} from "./viewpoint";

const UP: Triple = [0, 0, 1];
const rightOf = (view: { orientation: Quaternion }) => rotate(view.orientation, [1, 0, 0]);
const downOf = (view: { orientation: Quaternion }) => rotate(view.orientation, [0, 1, 0]);

function close(actual: readonly number[], expected: readonly number[]): void {
  actual.forEach((part, index) => {
    expect(part).toBeCloseTo(expected[index] as number, 6);
  });
}

describe("a viewpoint", () => {
  const view = lookAt([0, -5, 0], [0, 0, 0], UP);

  it("looks at its target with its down side down", () => {
    close(forwardOf(view), [0, 1, 0]);
    close(rightOf(view), [1, 0, 0]);
    close(downOf(view), [0, 0, -1]);
    close(targetOf(view), [0, 0, 0]);
  });

  it("turns about its target and stays level", () => {
    const turned = orbit(view, Math.PI / 2, -0.5, UP);
    close(targetOf(turned), [0, 0, 0]);
    expect(length(turned.position)).toBeCloseTo(5, 6);
    expect(turned.position[2]).toBeGreaterThan(0); // it looks down, so it is above
    expect(dot(rightOf(turned), UP)).toBeCloseTo(0, 9);
    expect(dot(forwardOf(turned), [1, 0, 0])).toBeGreaterThan(0.8); // clockwise from north is east
  });

  it("does not turn over at the zenith", () => {
    const steep = orbit(orbit(view, 0, -3, UP), 0.7, -3, UP);
    expect(forwardOf(steep)[2]).toBeGreaterThan(-1);
    expect(dot(rightOf(steep), UP)).toBeCloseTo(0, 9);
    const back = orbit(steep, 0, 1, UP);
    expect(downOf(back)[2]).toBeLessThan(0);
  });

  it.each([0.3, 2, Math.PI, -1.9])("keeps looking ahead when a camera rolled by %f is levelled", (roll) => {
    const rolled = { ...view, orientation: rotatedAbout(view.orientation, roll) };
    close(forwardOf(turn(rolled, 0, 0, UP)), forwardOf(rolled));
    expect(downOf(turn(rolled, 0, 0, UP))[2]).toBeLessThan(0);
  });

  it("moves in its own axes, and comes closer", () => {
    close(move(view, [1, 2, 3]).position, [1, -2, -2]);
    const near = zoom(view, 0.5);
    close(near.position, [0, -2.5, 0]);
    close(targetOf(near), [0, 0, 0]);
  });

  it("has a sphere in view, from its direction and from above", () => {
    const whole = framing(view, [1, 1, 1], 2, Math.PI / 6);
    close(whole.position, [1, -3, 1]);
    const top = fromAbove([1, 1, 1], 4, [1, 0, 0.5], UP);
    close(top.position, [1, 1, 5]);
    expect(forwardOf(top)[2]).toBeLessThan(-0.999);
    close(rightOf(top), [1, 0, 0]);
  });

  it("goes to another by the short way", () => {
    const other = orbit(view, 1.2, -0.4, UP);
    close(between(view, other, 0).orientation, view.orientation);
    close(forwardOf(between(view, other, 1)), forwardOf(other));
    const negated = { ...other, orientation: other.orientation.map((part) => -part) as Quaternion };
    const half = between(view, other, 0.5);
    close(forwardOf(between(view, negated, 0.5)), forwardOf(half));
    const angle = (a: Triple, b: Triple) => Math.acos(dot(a, b));
    expect(angle(forwardOf(view), forwardOf(half))).toBeLessThan(angle(forwardOf(view), forwardOf(other)));
    expect(length(minus(half.position, view.position))).toBeGreaterThan(0);
  });
});

/** An orientation turned about its own forward axis. */
function rotatedAbout(orientation: Quaternion, roll: number): Quaternion {
  const [w, x, y, z] = orientation;
  const [c, s] = [Math.cos(roll / 2), Math.sin(roll / 2)];
  return [w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s];
}
