import type { Triple } from "../api/artifacts";
import { conjugate, cross, minus, rotate } from "../geometry/vectors";
import { strings } from "../strings";
import type { Content, Layer } from "./content";
import type { Sample } from "./forecast";
import { type Lens, project } from "./lens";
import type { Segment } from "./lines";
import type { Palette } from "./palette";
import type { Points } from "./ply";
import type { Viewpoint } from "./viewpoint";
import type { Strokes } from "./webgl";

const FLAT_POINTS = 20_000;

/** What the overlay draws of a frame. */
export interface OverlayFrame {
  content: Content;
  view: Viewpoint;
  lens: Lens;
  width: number;
  height: number;
  palette: Palette;
  shown: ReadonlySet<Layer>;
  /** What WebGL would draw; null where it does. */
  flat: {
    strokes: readonly { layer: Layer; strokes: readonly Strokes[] }[];
    points: Points | null;
    samples: readonly Sample[];
    highlighted: readonly Segment[];
  } | null;
  /** Whether the view is that of a camera, whose image has a frame. */
  framed: boolean;
}

/** Draw what lies over the splat: numbers of stops, the frame of a camera's image, directions, and all where WebGL is missing. */
export function drawOverlay(context: CanvasRenderingContext2D, frame: OverlayFrame): void {
  const { width, height, palette, lens, view, content, shown } = frame;
  context.clearRect(0, 0, width, height);
  if (frame.flat) drawFlat(context, frame, frame.flat);
  if (frame.framed) drawFrame(context, frame);
  if (shown.has("route")) {
    context.font = "600 13px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    for (const route of content.routes) {
      for (const stop of route.stops) {
        const place = project(stop.position, view, lens);
        if (place)
          badge(
            context,
            String(stop.number),
            place,
            palette.of({ kind: "vehicle", number: route.vehicle }),
            palette,
          );
      }
    }
  }
  drawDirections(context, frame);
}

function drawFlat(
  context: CanvasRenderingContext2D,
  frame: OverlayFrame,
  { strokes, points, samples, highlighted }: NonNullable<OverlayFrame["flat"]>,
): void {
  const { shown, view, lens, palette } = frame;
  if (points && shown.has("points")) drawPoints(context, points, frame);
  if (shown.has("forecast")) {
    for (const sample of samples) {
      const place = project(sample.position, view, lens);
      if (place) dab(context, place, palette.ofValue(sample.value), 3);
    }
  }
  for (const { layer, strokes: lines } of strokes)
    if (shown.has(layer)) for (const one of lines) stroke(context, one.segments, one.colour, 2, frame);
  stroke(context, highlighted, palette.accent, 3, frame);
}

function dab(
  context: CanvasRenderingContext2D,
  [x, y]: readonly [number, number, number],
  colour: string,
  radius: number,
): void {
  context.fillStyle = colour;
  context.fillRect(x - radius, y - radius, 2 * radius, 2 * radius);
}

function badge(
  context: CanvasRenderingContext2D,
  text: string,
  [x, y]: readonly [number, number, number],
  colour: string,
  palette: Palette,
): void {
  context.beginPath();
  context.arc(x, y - 14, 10, 0, 2 * Math.PI);
  context.fillStyle = palette.back;
  context.fill();
  context.lineWidth = 2;
  context.strokeStyle = colour;
  context.stroke();
  context.fillStyle = palette.text;
  context.fillText(text, x, y - 13.5);
}

function stroke(
  context: CanvasRenderingContext2D,
  segments: readonly Segment[],
  colour: string,
  width: number,
  { view, lens }: OverlayFrame,
): void {
  context.beginPath();
  for (const [from, to] of segments) {
    const [start, end] = [project(from, view, lens), project(to, view, lens)];
    if (!start || !end) continue; // a line through the camera's plane would need clipping; frusta are short
    context.moveTo(start[0], start[1]);
    context.lineTo(end[0], end[1]);
  }
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}

function drawPoints(context: CanvasRenderingContext2D, points: Points, { view, lens }: OverlayFrame): void {
  const step = Math.max(1, Math.floor(points.count / FLAT_POINTS));
  const { positions, colours } = points;
  for (let point = 0; point < points.count; point += step) {
    const at = point * 3;
    const place = project([...positions.subarray(at, at + 3)] as Triple, view, lens);
    if (place) dab(context, place, `rgb(${colours[at]} ${colours[at + 1]} ${colours[at + 2]})`, 1);
  }
}

function drawFrame(context: CanvasRenderingContext2D, { width, height, lens, palette }: OverlayFrame): void {
  const { left, top, width: across, height: down } = lens.frame;
  context.save();
  context.beginPath();
  context.rect(0, 0, width, height);
  context.rect(left, top, across, down);
  context.globalAlpha = 0.75;
  context.fillStyle = palette.back;
  context.fill("evenodd");
  context.restore();
  context.strokeStyle = palette.accent;
  context.lineWidth = 2;
  context.strokeRect(left + 1, top + 1, across - 2, down - 2);
}

/** A north arrow where north is known, with east and up; else the axes of the model. */
function drawDirections(
  context: CanvasRenderingContext2D,
  { content, view, height, palette }: OverlayFrame,
): void {
  const { north, up } = content;
  const texts = strings.view3d.directions;
  const axes: [string, Triple, string][] = north
    ? [
        [texts.north, minus(north, [0, 0, 0]), palette.text],
        [texts.east, cross(north, up), palette.muted],
        [texts.up, up, palette.muted],
      ]
    : [
        ["x", [1, 0, 0], palette.muted],
        ["y", [0, 1, 0], palette.muted],
        ["z", [0, 0, 1], palette.muted],
      ];
  const [x, y] = [44, height - 44];
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.globalAlpha = 0.7;
  context.fillStyle = palette.back;
  context.beginPath();
  context.arc(x, y, 38, 0, 2 * Math.PI);
  context.fill();
  context.globalAlpha = 1;
  for (const [name, axis, colour] of axes) {
    const [right, down] = rotate(conjugate(view.orientation), axis);
    context.strokeStyle = colour;
    context.fillStyle = colour;
    context.lineWidth = colour === palette.text ? 3 : 1.5;
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + right * 24, y + down * 24);
    context.stroke();
    context.fillText(name, x + right * 32, y + down * 32);
  }
}
