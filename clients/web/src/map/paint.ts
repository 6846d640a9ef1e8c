import type { Schemas } from "../api/service";
import { colourOf, cssOf } from "../components/colour-map";
import type { Drawing, Selection } from "../store/scene";
import type { Theme } from "../theme";
import type { MapContents } from "./contents";
import type { Layer } from "./layers";
import { overlapColour, paintGrid, paintMetreGrid, unknownColour } from "./paint-ground";
import type { Palette } from "./palette";
import { Pen } from "./pen";
import type { Flat } from "./polygons";
import { fromScreen, type Viewport } from "./viewport";

/** What a picture of the map is made of. */
export interface Picture {
  view: Viewport;
  contents: MapContents["painted"]["value"];
  layers: ReadonlySet<Layer>;
  selection: Selection | null;
  colours: Palette;
  theme: Theme;
  /** Whether there are tiles below, in place of a background and a grid. */
  tiles: boolean;
  /** What is being drawn, or the chosen drawing as it is being changed. */
  sketch: { use: Drawing["use"]; corners: readonly Flat[]; finished: boolean; radius: number } | null;
  chosenDrawing: string | null;
  /** The middles of the edges of the chosen drawing, where a new corner can be pulled out. */
  middles: readonly Flat[];
  gap: { corners: readonly Flat[] } | null;
  /** Where the pointer is on the screen; null when it is elsewhere. */
  pointer: Flat | null;
  /** Whether keys move the pointer. */
  byKeys: boolean;
}

const VISIT_SIGNS: Record<Schemas["VisitState"], string> = { "going-to": "→", taken: "✓", failed: "✗" };

/** Draw the map; the context's unit is a px of CSS. */
export function paintMap(context: CanvasRenderingContext2D, picture: Picture): void {
  const { view, contents, layers, colours, theme } = picture;
  context.clearRect(0, 0, view.width, view.height);
  if (!picture.tiles) {
    context.fillStyle = colours.back;
    context.fillRect(0, 0, view.width, view.height);
    paintMetreGrid(context, view, colours);
  }
  if (layers.has("overlap") && contents.overlap)
    paintGrid(context, view, contents.overlap, theme, overlapColour);
  if (layers.has("forecast") && contents.forecast)
    paintGrid(context, view, contents.forecast.grid, theme, (share) => unknownColour(share, theme));
  const pen = new Pen(context, view, colours);
  if (layers.has("footprints")) paintFootprints(pen, picture);
  if (layers.has("drawings")) {
    for (const { corners, radius } of contents.noFly) pen.shape(corners, radius, colours.bad, false);
    for (const { drawing, corners } of contents.drawings)
      if (drawing.id !== picture.chosenDrawing) pen.drawing(drawing.use, corners, drawing.radius_m);
  }
  if (layers.has("photographs")) paintPhotographs(pen, picture);
  if (layers.has("candidates")) paintCandidates(pen, picture);
  if (layers.has("plan")) paintTours(pen, picture);
  if (layers.has("visits"))
    for (const { at, state, vehicle } of contents.visits)
      pen.label(at, `${VISIT_SIGNS[state]} ${vehicle}`, 0, -16);
  paintSketch(pen, picture);
  if (picture.byKeys && picture.pointer) pen.crosshair(picture.pointer);
}

function paintFootprints(pen: Pen, { contents, selection, colours }: Picture): void {
  const { context } = pen;
  for (const registered of [true, false]) {
    context.beginPath();
    for (const footprint of contents.footprints)
      if (footprint.registered === registered) pen.trace(footprint.corners, true);
    context.strokeStyle = registered ? colours.accent : colours.warn;
    context.lineWidth = 1;
    context.globalAlpha = 0.55;
    context.setLineDash(registered ? [] : [5, 4]);
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }
  const digest = selection?.kind === "image" ? selection.digest : null;
  const chosen = contents.footprints.find((one) => one.digest === digest);
  if (chosen) {
    pen.fill(chosen.corners, colours.accent, 0.3);
    pen.line(chosen.corners, colours.accent, 2, [], true);
  }
}

function paintPhotographs(pen: Pen, { contents, selection, colours }: Picture): void {
  const { photographs } = contents;
  const { context } = pen;
  context.beginPath();
  pen.trace(photographs.map((one) => one.at), false); // biome-ignore format: one line
  context.strokeStyle = colours.muted;
  context.lineWidth = 1.5;
  context.stroke();
  for (const { at, digest, registration } of photographs) {
    const chosen = selection?.kind === "image" && selection.digest === digest;
    if (registration === "registered") pen.dot(at, chosen ? 7 : 4, colours.accent);
    else if (registration === "unregistered") cross(pen, at, colours.bad);
    else pen.dot(at, 4, registration === "pending" ? colours.warn : colours.muted, true);
    if (chosen) pen.dot(at, 8, colours.text, true);
    if (chosen) pen.dot(at, 4, colours.accent);
  }
}

function cross(pen: Pen, at: Flat, colour: string): void {
  const size = 5 / pen.view.pxPerUnit;
  const [x, y] = at;
  pen.line([[x - size, y - size], [x + size, y + size]], colour, 2); // biome-ignore format: two corners
  pen.line([[x - size, y + size], [x + size, y - size]], colour, 2); // biome-ignore format: two corners
}

function paintCandidates(pen: Pen, { contents, selection, colours, theme, view }: Picture): void {
  const { candidates, reach } = contents;
  if (reach) {
    pen.dot(reach.at, 5, colours.text);
    if (reach.radius !== null) pen.circle(reach.at, reach.radius, colours.text);
  }
  const ranked = candidates.filter((one) => one.rank !== null).length;
  // The best last, so that they lie on top.
  for (const { id, at, towards, rank } of [...candidates].reverse()) {
    const colour =
      rank === null ? colours.muted : cssOf(colourOf((rank - 1) / Math.max(1, ranked - 1), theme));
    const tick = 14 / view.pxPerUnit;
    const tip: Flat = [at[0] + towards[0] * tick, at[1] + towards[1] * tick];
    if (rank !== null) pen.line([at, tip], colour, 2);
    const chosen = selection?.kind === "candidate" && selection.id === id;
    pen.dot(at, chosen ? 8 : rank === null ? 3 : 5, colour, rank === null);
    if (chosen) pen.dot(at, 10, colours.text, true);
    if (chosen) pen.dot(at, 7, colour);
  }
  for (const { at, rank } of candidates.filter((one) => one.rank !== null && one.rank <= 3))
    pen.label(at, String(rank), 0, -15);
}

function paintTours(pen: Pen, { contents, selection, colours }: Picture): void {
  for (const { vehicle, way, stops, start } of contents.tours) {
    const colour = colours.vehicle(vehicle);
    pen.line(way, colour, 3);
    way.forEach((corner, i) => {
      if (i > 0) pen.direction(way[i - 1] as Flat, corner, colour);
    });
    if (start) pen.label(start, "H", 0, 0, colours.text, colours.back);
    stops.forEach(({ id, at }, i) => {
      const chosen = selection?.kind === "stop" && selection.id === id;
      pen.label(at, String(i + 1), 0, 0, chosen ? colours.text : colour, colours.back);
    });
  }
}

function paintSketch(pen: Pen, { sketch, pointer, view, colours, middles, gap }: Picture): void {
  if (gap) pen.line(gap.corners, colours.text, 3, [4, 4], true);
  if (sketch === null) return;
  const { use, corners, finished, radius } = sketch;
  const shown = finished || pointer === null ? corners : [...corners, fromScreen(view, pointer)];
  if (finished || shown.length > 2 || use === "corridor") pen.drawing(use, shown, radius, true);
  else pen.line(shown, colours.text, 2);
  for (const middle of middles) pen.dot(middle, 3, colours.text, true);
  for (const corner of corners) pen.dot(corner, 6, colours.text, true);
}
