/** A length in m as metres or kilometres, with three digits. */
export function formatLength(metres: number): string {
  const kilometres = Math.abs(metres) >= 1000;
  return `${digits(kilometres ? metres / 1000 : metres)} ${kilometres ? "km" : "m"}`;
}

/** An area in m² as square metres, hectares or square kilometres, with three digits. */
export function formatArea(area: number): string {
  if (area < 10_000) return `${digits(area)} m²`;
  return area < 1_000_000 ? `${digits(area / 10_000)} ha` : `${digits(area / 1_000_000)} km²`;
}

function digits(value: number): string {
  const size = Math.abs(value);
  return value.toFixed(size >= 99.95 ? 0 : size >= 9.995 ? 1 : 2);
}
