const WINDOW_MS = 30_000;

/** How fast something goes on, by its last half minute. */
export class Rate {
  private samples: { at: number; total: number }[] = [];

  /** Note a total at a time in ms. */
  add(total: number, at: number): void {
    this.samples.push({ at, total });
    while (this.samples.length > 2 && (this.samples[1]?.at ?? at) < at - WINDOW_MS) this.samples.shift();
  }

  /** The increase per s; null while it is not known. */
  perSecond(): number | null {
    const first = this.samples[0];
    const last = this.samples.at(-1);
    if (!first || !last || last.at - first.at < 500) return null;
    return ((last.total - first.total) / (last.at - first.at)) * 1000;
  }
}
