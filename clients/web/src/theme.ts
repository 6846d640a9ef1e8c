import { effect, signal } from "@preact/signals";

const NAME = "fvs-theme";
export type Theme = "dark" | "light";

const preferred: Theme = matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";

/** Dark or light: as the system prefers until the operator chooses. */
export const theme = signal<Theme>((localStorage.getItem(NAME) as Theme | null) ?? preferred);

effect(() => {
  document.documentElement.dataset["theme"] = theme.value;
});

const VEHICLES = 6;

/** The name of the custom property with the colour of a vehicle, from 1. */
export function vehicleColour(vehicle: number): string {
  return `--vehicle-${((vehicle - 1) % VEHICLES) + 1}`;
}

export function toggleTheme(): void {
  theme.value = theme.value === "dark" ? "light" : "dark";
  localStorage.setItem(NAME, theme.value);
}
