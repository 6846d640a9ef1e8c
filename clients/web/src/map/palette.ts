import { theme, vehicleColour } from "../theme";

/** The colours of the map, by the page's theme. */
export interface Palette {
  back: string;
  line: string;
  text: string;
  muted: string;
  accent: string;
  good: string;
  warn: string;
  bad: string;
  vehicle: (number: number) => string;
}

/** The colours of the theme that is shown. */
export function palette(): Palette {
  void theme.value; // drawn again in other colours
  const style = getComputedStyle(document.documentElement);
  const variable = (name: string) => style.getPropertyValue(name).trim();
  const colour = (name: string) => variable(`--${name}`);
  return {
    back: colour("sunken"),
    line: colour("line"),
    text: colour("text"),
    muted: colour("muted"),
    accent: colour("accent"),
    good: colour("good"),
    warn: colour("warn"),
    bad: colour("bad"),
    vehicle: (number) => variable(vehicleColour(number)),
  };
}
