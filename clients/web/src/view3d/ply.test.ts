import { describe, expect, it } from "vitest";
import { parsePoints } from "./ply";

const HEADER = [
  "ply",
  "format binary_little_endian 1.0",
  "element vertex 2",
  "property float x",
  "property float y",
  "property float z",
  "property uchar red",
  "property uchar green",
  "property uchar blue",
  "end_header\n",
].join("\n");

function file(header: string, bytes = 30): ArrayBuffer {
  const content = new Uint8Array(header.length + bytes);
  content.set(new TextEncoder().encode(header));
  const view = new DataView(content.buffer, header.length);
  [1.5, -2, 3].forEach((part, index) => {
    view.setFloat32(15 + 4 * index, part, true);
  });
  content.set([255, 0, 7], header.length + 27);
  return content.buffer;
}

describe("points of a PLY file", () => {
  it("have positions and colours", () => {
    const points = parsePoints(file(HEADER));
    expect(points.count).toBe(2);
    expect([...points.positions]).toEqual([0, 0, 0, 1.5, -2, 3]);
    expect([...points.colours]).toEqual([0, 0, 0, 255, 0, 7]);
  });

  it("may be none", () => {
    expect(parsePoints(file(HEADER.replace("vertex 2", "vertex 0"))).count).toBe(0);
  });

  it.each([
    ["no PLY", file(HEADER.replace("ply\n", "gif\n"))],
    ["no colours", file(HEADER.replace("uchar blue", "uchar alpha"))],
    ["not binary", file(HEADER.replace("binary_little_endian", "ascii"))],
    ["cut off", file(HEADER.replace("vertex 2", "vertex 9"))],
  ])("are refused: %s", (_, bad) => {
    expect(() => parsePoints(bad)).toThrow(/PLY file/);
  });
});
