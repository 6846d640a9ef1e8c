import { colourOf, type Rgb } from "../components/colour-map";
import type { Theme } from "../theme";
import type { GroundGrid } from "./ground-grid";
import type { Palette } from "./palette";
import { fromScreen, scaleLength, toScreen, type Viewport } from "./viewport";

const OPACITY = 0.55;

/** The colours of places that 0, 1 and 2 photographs see, and those of more. */
export const OVERLAP_COLOURS: readonly Rgb[] = [
  [0.8, 0.1, 0.15],
  [0.95, 0.45, 0.1],
  [0.98, 0.8, 0.25],
  [0.15, 0.55, 0.85],
];

export function overlapColour(count: number): Rgb {
  return OVERLAP_COLOURS[Math.min(3, count)] as Rgb;
}

const images = new WeakMap<GroundGrid, { theme: Theme; canvas: HTMLCanvasElement }>();

/** A grid in colours; `colour` gives that of a value. */
export function paintGrid(
  context: CanvasRenderingContext2D,
  view: Viewport,
  grid: GroundGrid,
  theme: Theme,
  colour: (value: number) => Rgb,
): void {
  let image = images.get(grid);
  if (image?.theme !== theme) {
    image = { theme, canvas: imageOf(grid, colour) };
    images.set(grid, image);
  }
  const { west, south, cell, columns, rows } = grid;
  const [left, top] = toScreen(view, [west, south + rows * cell]);
  context.imageSmoothingEnabled = false;
  context.globalAlpha = OPACITY;
  context.drawImage(image.canvas, left, top, columns * cell * view.pxPerUnit, rows * cell * view.pxPerUnit);
  context.globalAlpha = 1;
}

function imageOf({ columns, rows, values }: GroundGrid, colour: (value: number) => Rgb): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  canvas.width = columns;
  canvas.height = rows;
  const pixels = new ImageData(columns, rows);
  values.forEach((value, index) => {
    if (Number.isNaN(value)) return;
    const row = rows - 1 - Math.floor(index / columns);
    const at = 4 * (row * columns + (index % columns));
    pixels.data.set([...colour(value).map((part) => part * 255), 255], at);
  });
  canvas.getContext("2d", { willReadFrequently: true })?.putImageData(pixels, 0, 0); // beside the map, not on a GPU
  return canvas;
}

/** The colour of a share from 0 to 1 of what is not known: the most stands out most. */
export function unknownColour(share: number, theme: Theme): Rgb {
  return colourOf(1 - share, theme);
}

/** Lines at round distances from the origin. */
export function paintMetreGrid(context: CanvasRenderingContext2D, view: Viewport, colours: Palette): void {
  const step = scaleLength(view, 160);
  const [west, north] = fromScreen(view, [0, 0]);
  const [east, south] = fromScreen(view, [view.width, view.height]);
  context.strokeStyle = colours.line;
  context.lineWidth = 0.5;
  context.beginPath();
  for (let x = Math.ceil(west / step) * step; x <= east; x += step) {
    const [u] = toScreen(view, [x, 0]);
    context.moveTo(u, 0);
    context.lineTo(u, view.height);
  }
  for (let y = Math.ceil(south / step) * step; y <= north; y += step) {
    const [, v] = toScreen(view, [0, y]);
    context.moveTo(0, v);
    context.lineTo(view.width, v);
  }
  context.stroke();
}
