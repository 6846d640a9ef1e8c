import { effect, type Signal, signal } from "@preact/signals";
import { metric } from "../candidates/site";
import { perScene } from "../store/per-scene";
import type { SceneStore } from "../store/scene";
import { stored } from "../store/stored";
import { flying, type MissionPart, missionParts } from "./mission-files";
import { MISSION, type MissionForm, type MissionSource, objection } from "./mission-form";

/** Which files were prepared, and for what. */
export interface Prepared {
  /** What they were made of, to tell when it changed. */
  key: string;
  parts: readonly MissionPart[];
}

/** The mission's form of a scene, remembered in this browser session, and the files that were prepared with it. */
export class MissionState {
  readonly form: Signal<MissionForm>;
  readonly busy = signal(false);
  readonly failure = signal<unknown>(null);
  readonly prepared = signal<Prepared | null>(null);

  private aborter = new AbortController();

  constructor(private readonly store: SceneStore) {
    const name = `fvs-mission ${store.id}`;
    this.form = signal({ ...MISSION, ...stored<Partial<MissionForm>>(sessionStorage, name, {}) });
    effect(() => sessionStorage.setItem(name, JSON.stringify(this.form.value)));
  }

  /** The form with a source that is there and a format that can be written, where what was chosen is not. */
  usable(): MissionForm {
    const form = this.form.value;
    const { ranking, plan, frames } = this.store;
    const ready: Record<MissionSource, boolean> = {
      plan: plan.value !== null,
      ranking: ranking.value !== null,
      photographs: true,
    };
    const source = ready[form.source]
      ? form.source
      : ready.plan
        ? "plan"
        : ready.ranking
          ? "ranking"
          : "photographs";
    const georeferenced = frames.value?.georeferenced ?? false;
    const formats = [form.format, "qgc-plan", "ros-posearray", "nerfstudio"] as const;
    const writable = (one: MissionForm["format"]) =>
      objection(one, georeferenced, metric(this.store)) === null;
    const vehicle = flying(plan.value).includes(form.vehicle) ? form.vehicle : "";
    return { ...form, source, vehicle, format: formats.find(writable) ?? "nerfstudio" };
  }

  /** What files are made of now. */
  key(): string {
    const { ranking, plan, drawings } = this.store;
    return JSON.stringify([this.usable(), ranking.value?.id, plan.value?.id, drawings.value]);
  }

  /** Write all files of the mission. */
  async prepare(): Promise<void> {
    this.aborter.abort();
    const aborter = new AbortController();
    this.aborter = aborter;
    this.busy.value = true;
    this.failure.value = null;
    this.prepared.value = null;
    const key = this.key();
    const { ranking, plan, drawings, id } = this.store;
    const material = {
      sceneId: id,
      ranking: ranking.peek(),
      plan: plan.peek(),
      drawings: drawings.peek(),
    };
    try {
      const parts = await missionParts(this.usable(), material, aborter.signal);
      this.prepared.value = { key, parts };
    } catch (error) {
      if (!aborter.signal.aborted) this.failure.value = error;
    } finally {
      if (this.aborter === aborter) this.busy.value = false;
    }
  }
}

/** The mission of a scene. */
export const missionState = perScene((store) => new MissionState(store));
