import type { Schemas } from "../api/service";

export const COLUMNS = ["rank", "id", "score", "coverage", "chance", "distance", "status"] as const;
export type Column = (typeof COLUMNS)[number];

/** By which column a table is sorted. */
export interface Order {
  column: Column;
  descending: boolean;
}

/** Candidates in an order; those without a value come last. */
export function sorted(
  candidates: readonly Schemas["RankedCandidate"][],
  { column, descending }: Order,
): readonly Schemas["RankedCandidate"][] {
  const sign = descending ? -1 : 1;
  return [...candidates].sort((a, b) => {
    const [left, right] = [value(a, column), value(b, column)];
    if (left === null || right === null) return Number(left === null) - Number(right === null);
    if (typeof left === "string") return sign * left.localeCompare(String(right), "en", { numeric: true });
    return sign * (left - Number(right));
  });
}

function value(candidate: Schemas["RankedCandidate"], column: Column): number | string | null {
  return column === "distance" ? candidate.distance_m : candidate[column];
}
