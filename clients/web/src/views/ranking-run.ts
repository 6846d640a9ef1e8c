import { effect, signal, untracked } from "@preact/signals";
import { rankingParts } from "../api/rankings";
import type { Schemas } from "../api/service";
import { expectedOf, followChosenDrawing } from "../candidates/candidates-form";
import { siteOf } from "../candidates/site";
import { perScene } from "../store/per-scene";
import type { SceneStore } from "../store/scene";
import { RANKING, rankingRequest } from "./ranking-form";

/** How far a ranking is. */
export interface Progress {
  scored: number;
  /** How many candidates there are, at most; null while only the service knows. */
  expected: number | null;
}

/** What the panel of next views has of a scene: its form, and the ranking that is being made. */
export class RankingRun {
  readonly form = signal(RANKING);
  /** Whether a new snapshot is ranked with the form as soon as it is there. */
  readonly keepUpToDate = signal(false);
  /** Null while no ranking is made. */
  readonly progress = signal<Progress | null>(null);
  /** Why there is no new ranking; null where nothing failed. */
  readonly failure = signal<unknown>(null);

  private aborter = new AbortController();

  constructor(private readonly store: SceneStore) {
    followChosenDrawing(store, this.form);
    let ranked = store.snapshots.peek()[0]?.id;
    effect(() => {
      const ready = store.cameras.value !== null; // those of a new snapshot arrive after it
      untracked(() => {
        const newest = store.snapshots.value[0]?.id;
        if (!ready || newest === ranked) return;
        ranked = newest;
        if (this.keepUpToDate.value && this.progress.value === null) void this.start();
      });
    });
  }

  /** Rank what the form says. */
  async start(): Promise<void> {
    const site = siteOf(this.store);
    if (site === null) return;
    this.failure.value = null;
    this.aborter = new AbortController();
    try {
      const chosen = this.store.chosenSnapshot.peek();
      await this.follow(
        rankingRequest(this.form.peek(), site, chosen && (this.store.snapshot.peek()?.id ?? null)),
      );
    } catch (error) {
      if (!this.aborter.signal.aborted) this.failure.value = error;
    } finally {
      this.progress.value = null;
    }
  }

  cancel(): void {
    this.aborter.abort();
  }

  private async follow(request: Schemas["RankingRequest"]): Promise<void> {
    const scored = new Set<string>();
    const expected = request.generator ? expectedOf(request.generator) : (request.candidates?.length ?? null);
    this.progress.value = { scored: 0, expected };
    for await (const part of rankingParts(this.store.id, request, this.aborter.signal)) {
      for (const candidate of part.candidates) scored.add(candidate.id);
      this.progress.value = { scored: scored.size, expected };
      if (part.ranking) this.store.ranking.value = part.ranking;
    }
  }
}

/** The run of a scene. */
export const rankingRun = perScene((store) => new RankingRun(store));
