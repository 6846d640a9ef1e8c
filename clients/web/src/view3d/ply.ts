/** Sparse points: x, y and z of each in the model frame, and red, green and blue of each. */
export interface Points {
  count: number;
  positions: Float32Array;
  /** From 0 to 255. */
  colours: Uint8Array;
}

const HEADER_END = "end_header\n";
const SIZES: Record<string, number> = {
  char: 1,
  uchar: 1,
  short: 2,
  ushort: 2,
  int: 4,
  uint: 4,
  float: 4,
  double: 8,
};

/** Read the points of a binary PLY file, `points.ply` of a snapshot. Throws when it is none. */
export function parsePoints(file: ArrayBuffer): Points {
  const text = new TextDecoder("latin1").decode(new Uint8Array(file, 0, Math.min(file.byteLength, 4096)));
  const end = text.indexOf(HEADER_END);
  if (!text.startsWith("ply\n") || end < 0) throw new Error("This is no PLY file.");
  const lines = text.slice(0, end).split("\n");
  if (!lines.includes("format binary_little_endian 1.0")) throw new Error("This PLY file is not binary.");
  const count = Number(/^element vertex (\d+)$/m.exec(text)?.[1]);
  const offsets = new Map<string, number>();
  let stride = 0;
  for (const [, type, name] of text.slice(0, end).matchAll(/^property (\w+) (\w+)$/gm)) {
    offsets.set(name as string, stride);
    stride += SIZES[type as string] ?? Number.NaN;
  }
  const columns = ["x", "y", "z", "red", "green", "blue"].map((name) => offsets.get(name) ?? Number.NaN);
  const start = end + HEADER_END.length;
  if (!Number.isFinite(count + stride + columns.reduce((sum, one) => sum + one, 0)))
    throw new Error("This PLY file has no coloured points.");
  if (start + count * stride > file.byteLength) throw new Error("This PLY file is cut off.");
  const view = new DataView(file, start);
  const positions = new Float32Array(count * 3);
  const colours = new Uint8Array(count * 3);
  for (let point = 0; point < count; point++) {
    for (let part = 0; part < 3; part++) {
      positions[point * 3 + part] = view.getFloat32(point * stride + (columns[part] as number), true);
      colours[point * 3 + part] = view.getUint8(point * stride + (columns[part + 3] as number));
    }
  }
  return { count, positions, colours };
}
