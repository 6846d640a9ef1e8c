import { signal } from "@preact/signals";
import { api, data, type Schemas } from "../api/service";

const PAGE = 50;

/** The scenes of the service, the newest first, a page at a time. */
export class SceneList {
  /** Null until the first page is here. */
  readonly scenes = signal<readonly Schemas["Scene"][] | null>(null);
  readonly hasMore = signal(false);
  private next: string | null = null;

  /** Load as many scenes again as are known, at least a page. */
  async reload(): Promise<void> {
    const wanted = this.scenes.value?.length ?? 0;
    let scenes: Schemas["Scene"][] = [];
    let after: string | null = null;
    do {
      const page: Schemas["SceneList"] = await load(after);
      scenes = scenes.concat(page.items);
      after = page.next;
    } while (after !== null && scenes.length < wanted);
    this.show(scenes, after);
  }

  async loadMore(): Promise<void> {
    const page = await load(this.next);
    this.show([...(this.scenes.value ?? []), ...page.items], page.next);
  }

  /** Load all that there are, to search in. */
  async loadAll(): Promise<void> {
    while (this.next !== null) await this.loadMore();
  }

  private show(scenes: readonly Schemas["Scene"][], next: string | null): void {
    this.scenes.value = scenes;
    this.next = next;
    this.hasMore.value = next !== null;
  }
}

function load(after: string | null): Promise<Schemas["SceneList"]> {
  const query = after === null ? { limit: PAGE } : { limit: PAGE, after };
  return data(api.GET("/v1/scenes", { params: { query } }));
}

/** Scenes that have a text in their name, in any case. */
export function named(scenes: readonly Schemas["Scene"][], text: string): readonly Schemas["Scene"][] {
  const wanted = text.trim().toLocaleLowerCase();
  return wanted ? scenes.filter((scene) => scene.name.toLocaleLowerCase().includes(wanted)) : scenes;
}
