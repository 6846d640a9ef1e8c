import type { Drawing } from "../store/scene";
import type { Palette } from "./palette";
import type { Flat } from "./polygons";
import { toScreen, type Viewport } from "./viewport";

/** Draws shapes of the plane on a canvas, in a view. */
export class Pen {
  constructor(
    readonly context: CanvasRenderingContext2D,
    readonly view: Viewport,
    readonly colours: Palette,
  ) {}

  /** Add a line through corners to the path, back to the first where `closed`. */
  trace(corners: readonly Flat[], closed: boolean): void {
    corners.forEach((corner, i) => {
      const [u, v] = toScreen(this.view, corner);
      if (i === 0) this.context.moveTo(u, v);
      else this.context.lineTo(u, v);
    });
    if (closed && corners.length) this.context.closePath();
  }

  /** A line through corners, with an outline that stands out from everything below. */
  line(corners: readonly Flat[], colour: string, width: number, dash: number[] = [], closed = false): void {
    const { context } = this;
    context.beginPath();
    this.trace(corners, closed);
    context.strokeStyle = this.colours.back;
    context.lineWidth = width + 2;
    context.stroke();
    context.setLineDash(dash);
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke();
    context.setLineDash([]);
  }

  fill(corners: readonly Flat[], colour: string, opacity: number): void {
    this.context.beginPath();
    this.trace(corners, true);
    this.context.globalAlpha = opacity;
    this.context.fillStyle = colour;
    this.context.fill();
    this.context.globalAlpha = 1;
  }

  /** A disc of a radius in px; a ring where `hollow`. */
  dot(at: Flat, radius: number, colour: string, hollow = false): void {
    const { context } = this;
    const [u, v] = toScreen(this.view, at);
    context.beginPath();
    context.arc(u, v, radius, 0, 2 * Math.PI);
    context.fillStyle = hollow ? this.colours.back : colour;
    context.fill();
    context.strokeStyle = hollow ? colour : this.colours.back;
    context.lineWidth = hollow ? 2 : 1;
    context.stroke();
  }

  /** A circle of a radius in units of the plane. */
  circle(at: Flat, radius: number, colour: string): void {
    const { context } = this;
    const [u, v] = toScreen(this.view, at);
    context.beginPath();
    context.arc(u, v, radius * this.view.pxPerUnit, 0, 2 * Math.PI);
    context.setLineDash([8, 5]);
    context.strokeStyle = colour;
    context.lineWidth = 2;
    context.stroke();
    context.setLineDash([]);
  }

  /** A short text on a background, centred at a place or shifted from it by px. */
  label(at: Flat, text: string, du = 0, dv = 0, back = this.colours.back, front = this.colours.text): void {
    const { context } = this;
    const [u, v] = toScreen(this.view, at);
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    const width = Math.max(18, context.measureText(text).width + 8);
    context.fillStyle = back;
    context.beginPath();
    context.roundRect(u + du - width / 2, v + dv - 9, width, 18, 9);
    context.fill();
    context.fillStyle = front;
    context.fillText(text, u + du, v + dv + 0.5);
  }

  /** An arrow head in the middle of a leg, where it is long enough on the screen. */
  direction(from: Flat, to: Flat, colour: string): void {
    const [a, b] = [toScreen(this.view, from), toScreen(this.view, to)];
    const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (length < 30) return;
    const [x, y] = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
    const [u, v] = [(a[0] + b[0]) / 2 + 6 * x, (a[1] + b[1]) / 2 + 6 * y];
    const { context } = this;
    context.beginPath();
    context.moveTo(u, v);
    context.lineTo(u - 11 * x - 6 * y, v - 11 * y + 6 * x);
    context.lineTo(u - 11 * x + 6 * y, v - 11 * y - 6 * x);
    context.closePath();
    context.fillStyle = colour;
    context.fill();
  }

  /** What may or may not be flown in; `radius` is how far a corridor reaches from its line. */
  drawing(use: Drawing["use"], corners: readonly Flat[], radius: number, wide = false): void {
    const colours = { area: "good", corridor: "good", fence: "warn", "no-fly": "bad" } as const;
    this.shape(
      corners,
      use === "corridor" ? radius : null,
      this.colours[colours[use]],
      use === "fence",
      wide,
    );
  }

  /** A polygon, or a line that reaches `radius` to its sides. */
  shape(
    corners: readonly Flat[],
    radius: number | null,
    colour: string,
    hollow: boolean,
    wide = false,
  ): void {
    const { context } = this;
    if (radius !== null) {
      context.beginPath();
      this.trace(corners, false);
      context.globalAlpha = 0.25;
      context.strokeStyle = colour;
      context.lineWidth = 2 * radius * this.view.pxPerUnit;
      context.lineCap = "round";
      context.lineJoin = "round";
      context.stroke();
      context.globalAlpha = 1;
      this.line(corners, colour, wide ? 3 : 2);
      return;
    }
    if (!hollow) this.fill(corners, colour, 0.2);
    this.line(corners, colour, wide ? 3 : 2, hollow ? [10, 5] : [], true);
  }

  crosshair([u, v]: Flat): void {
    const { context } = this;
    for (const [width, colour] of [
      [4, this.colours.back],
      [2, this.colours.text],
    ] as const) {
      context.beginPath();
      for (const [x, y] of [
        [1, 0],
        [-1, 0],
        [0, 1],
        [0, -1],
      ] as const) {
        // biome-ignore format: four arms
        context.moveTo(u + 5 * x, v + 5 * y);
        context.lineTo(u + 16 * x, v + 16 * y);
      }
      context.lineWidth = width;
      context.strokeStyle = colour;
      context.stroke();
    }
  }
}
