import { colourOf, cssOf, type Rgb } from "../components/colour-map";
import { theme, vehicleColour } from "../theme";
import type { Paint } from "./content";

/** The view's colours in the present theme, from CSS variables of the stage. */
export interface Palette {
  text: string;
  muted: string;
  accent: string;
  back: string;
  line: string;
  of: (paint: Paint) => string;
  ofValue: (value: number) => string;
}

/** Read the palette of an element. */
export function paletteOf(element: HTMLElement): Palette {
  const style = getComputedStyle(element);
  const variable = (name: string) => style.getPropertyValue(name).trim();
  const now = theme.value;
  const ofValue = (value: number) => cssOf(colourOf(value, now));
  return {
    text: variable("--text"),
    muted: variable("--muted"),
    accent: variable("--accent"),
    back: variable("--sunken"),
    line: variable("--line"),
    ofValue,
    of: (paint) => {
      if (paint.kind === "rank") return ofValue(paint.value);
      if (paint.kind === "vehicle") return variable(vehicleColour(paint.number));
      return variable(`--marker-${paint.kind}`);
    },
  };
}

/** Parts from 0 to 1 of a colour in one of the forms that the palette has: `#rrggbb` or `rgb(r g b)`. */
export function partsOf(colour: string): Rgb {
  const parts = colour.startsWith("#")
    ? [1, 3, 5].map((at) => Number.parseInt(colour.slice(at, at + 2), 16))
    : (colour.match(/\d+/g) ?? []).map(Number);
  return [0, 1, 2].map((at) => (parts[at] ?? 0) / 255) as Rgb;
}
