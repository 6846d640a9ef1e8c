import { signal } from "@preact/signals";
import { api, data } from "../api/service";
import { followChosenDrawing } from "../candidates/candidates-form";
import { siteOf } from "../candidates/site";
import { perScene } from "../store/per-scene";
import type { SceneStore } from "../store/scene";
import { type From, PLAN, planRequest } from "./plan-form";

/** What the panel of plans has of a scene: its form, and the plan that is being made. */
export class PlanRun {
  readonly form = signal(PLAN);
  readonly busy = signal(false);
  /** Why there is no new plan; null where nothing failed. */
  readonly failure = signal<unknown>(null);

  private from: From | null = null;

  constructor(private readonly store: SceneStore) {
    followChosenDrawing(store, this.form);
  }

  /** Plan what the form says. */
  async start(): Promise<void> {
    await this.startFrom(null);
  }

  /** Plan with the form's settings, but from candidates that are not the form's; null: from the form's. */
  async startFrom(from: From | null): Promise<void> {
    this.from = from;
    await this.again();
  }

  /** Ask again for what was asked for last. */
  async again(): Promise<void> {
    const site = siteOf(this.store);
    if (site === null || this.busy.peek()) return;
    this.busy.value = true;
    this.failure.value = null;
    try {
      const chosen = this.store.chosenSnapshot.peek() && (this.store.snapshot.peek()?.id ?? null);
      const options = {
        params: { path: { scene_id: this.store.id } },
        body: planRequest(this.form.peek(), site, chosen, this.from),
      };
      this.store.plan.value = await data(api.POST("/v1/scenes/{scene_id}/plans", options));
    } catch (error) {
      this.failure.value = error;
    } finally {
      this.busy.value = false;
    }
  }
}

/** The run of a scene. */
export const planRun = perScene((store) => new PlanRun(store));
