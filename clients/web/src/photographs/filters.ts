import type { Schemas } from "../api/service";

type Image = Schemas["Image"];

export const FILTERS = ["all", "problems", "pending", "registered", "unregistered", "excluded"] as const;
export type Filter = (typeof FILTERS)[number];

/** Whether something is wrong with an image that the operator can mend or should know. */
export function isProblem(image: Image): boolean {
  return (
    !["accepted", "video"].includes(image.verdict) ||
    ["unregistered", "quarantined"].includes(image.registration) ||
    image.warnings.length > 0
  );
}

const MATCHES: Record<Filter, (image: Image) => boolean> = {
  all: () => true,
  problems: isProblem,
  pending: (image) => image.registration === "pending",
  registered: (image) => image.registration === "registered",
  unregistered: (image) => image.registration === "unregistered",
  excluded: (image) => ["excluded", "quarantined"].includes(image.registration),
};

/** How many images each filter shows. */
export function countsOf(images: readonly Image[]): Record<Filter, number> {
  const counts = Object.fromEntries(FILTERS.map((filter) => [filter, 0])) as Record<Filter, number>;
  for (const image of images) {
    for (const filter of FILTERS) if (MATCHES[filter](image)) counts[filter]++;
  }
  return counts;
}

const ORDER = new Intl.Collator("en", { numeric: true });

/** The images that a filter shows and whose names contain a text, in any case; by name, numbers by value. */
export function filtered(images: readonly Image[], filter: Filter, text: string): readonly Image[] {
  const wanted = text.trim().toLocaleLowerCase();
  return images
    .filter((image) => MATCHES[filter](image) && (!wanted || image.name.toLocaleLowerCase().includes(wanted)))
    .sort((one, other) => ORDER.compare(one.name, other.name));
}
