import type { Theme } from "../theme";

/** An sRGB colour, each part from 0 to 1. */
export type Rgb = [number, number, number];

/** Viridis (CC0, Smith and van der Walt) at equal distances: its lightness grows evenly, also for colour-blind eyes. */
const VIRIDIS = "440154 472d7b 3b528b 2c728e 21918c 28ae80 5ec962 addc30 fde725"
  .split(" ")
  .map((hex) => [0, 2, 4].map((at) => Number.parseInt(hex.slice(at, at + 2), 16) / 255) as Rgb);

/** The part of the map that stands out from the background of a theme. */
const LEGIBLE: Record<Theme, [number, number]> = { dark: [1, 0.28], light: [0, 0.78] };

/** The colour of a value from 0, which stands out most from the theme's background, to 1. */
export function colourOf(value: number, theme: Theme): Rgb {
  const [first, last] = LEGIBLE[theme];
  const along = Math.min(1, Math.max(0, value));
  const place = (first + (last - first) * along) * (VIRIDIS.length - 1);
  const index = Math.min(Math.floor(place), VIRIDIS.length - 2);
  const [from, to] = [VIRIDIS[index] as Rgb, VIRIDIS[index + 1] as Rgb];
  return from.map((part, at) => part + ((to[at] as number) - part) * (place - index)) as Rgb;
}

/** A colour as CSS has it. */
export function cssOf(colour: Rgb): string {
  return `rgb(${colour.map((part) => Math.round(part * 255)).join(" ")})`;
}
