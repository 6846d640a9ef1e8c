import { effect, signal, untracked } from "@preact/signals";
import { api, data } from "../api/service";
import { siteOf } from "../candidates/site";
import { perScene } from "../store/per-scene";
import type { SceneStore } from "../store/scene";
import { type ForecastPlace, forecastRequest } from "./forecast-form";
import { rankingRun } from "./ranking-run";

/** The forecast that is shown of a scene; it follows the shown snapshot. */
export class ForecastRun {
  /** Where it is shown; null: nowhere. */
  readonly place = signal<ForecastPlace | null>(null);
  readonly busy = signal(false);
  readonly failure = signal<unknown>(null);

  private last = 0;

  constructor(private readonly store: SceneStore) {
    effect(() => {
      const place = this.place.value;
      const ranking = place === "candidates" ? store.ranking.value : null;
      const ready = store.cameras.value !== null; // those of a new snapshot arrive after it
      if (place === null) store.forecast.value = null;
      else if (ready) untracked(() => void this.load(place, ranking));
    });
  }

  /** Ask again for what is shown. */
  again(): void {
    const place = this.place.peek();
    if (place) void this.load(place, this.store.ranking.peek());
  }

  private async load(place: ForecastPlace, ranking: typeof this.store.ranking.value): Promise<void> {
    const site = siteOf(this.store);
    if (!site) return;
    const number = ++this.last;
    this.busy.value = true;
    this.failure.value = null;
    try {
      const chosen = this.store.chosenSnapshot.peek() && (this.store.snapshot.peek()?.id ?? null);
      const form = rankingRun(this.store).form.peek().candidates;
      const body = forecastRequest(place, site, ranking, form, chosen);
      const params = { path: { scene_id: this.store.id } };
      const forecast = await data(api.POST("/v1/scenes/{scene_id}/forecasts", { params, body }));
      if (number === this.last && this.place.peek() !== null) this.store.forecast.value = forecast;
    } catch (error) {
      if (number === this.last) this.failure.value = error;
    } finally {
      if (number === this.last) this.busy.value = false;
    }
  }
}

/** The forecast of a scene. */
export const forecastRun = perScene((store) => new ForecastRun(store));
