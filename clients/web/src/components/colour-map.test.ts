import { describe, expect, it } from "vitest";
import { colourOf, cssOf, type Rgb } from "./colour-map";

function luminance(colour: Rgb): number {
  const [red, green, blue] = colour.map((part) =>
    part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4,
  ) as Rgb;
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
}

const contrast = (one: number, other: number) =>
  (Math.max(one, other) + 0.05) / (Math.min(one, other) + 0.05);
const VALUES = Array.from({ length: 21 }, (_, step) => step / 20);

describe("the colour map", () => {
  it.each([
    ["dark", "#0a0d10", 2.2],
    ["light", "#e6ebf0", 1.5],
  ] as const)("is monotonous in lightness and legible on %s", (theme, back, least) => {
    const ground = luminance([1, 3, 5].map((at) => Number.parseInt(back.slice(at, at + 2), 16) / 255) as Rgb);
    const lightness = VALUES.map((value) => luminance(colourOf(value, theme)));
    for (const one of lightness) expect(contrast(one, ground)).toBeGreaterThan(least);
    const steps = lightness.slice(1).map((one, index) => one - (lightness[index] as number));
    expect(new Set(steps.map(Math.sign)).size).toBe(1);
    // The best stand out most.
    const first = contrast(lightness[0] as number, ground);
    for (const one of lightness) expect(contrast(one, ground)).toBeLessThanOrEqual(first);
  });

  it("holds at its ends, and becomes CSS", () => {
    expect(cssOf(colourOf(-1, "light"))).toBe("rgb(68 1 84)");
    expect(colourOf(2, "dark")).toEqual(colourOf(1, "dark"));
  });
});
