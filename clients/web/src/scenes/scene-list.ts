import { signal } from "@preact/signals";
import { api, data, type Schemas } from "../api/service";

const PAGE = 50;

/** The scenes of the service, the newest first, a page at a time. */
export class SceneList {
  /** Those whose names contain the searched text; null until the first page is here. */
  readonly scenes = signal<readonly Schemas["Scene"][] | null>(null);
  readonly hasMore = signal(false);
  /** The text that was searched for, empty for all scenes. */
  readonly searched = signal("");
  private next: string | null = null;
  private wanted = "";

  /** Show the scenes whose names contain a text, in any case. */
  async search(text: string): Promise<void> {
    this.wanted = text.trim();
    await this.load(1);
  }

  /** Load as many scenes again as are known, at least a page. */
  async reload(): Promise<void> {
    await this.load(this.scenes.value?.length ?? 1);
  }

  async loadMore(): Promise<void> {
    const text = this.wanted;
    const page = await load(text, this.next);
    if (text === this.wanted) this.show(text, [...(this.scenes.value ?? []), ...page.items], page.next);
  }

  /** Load whole pages until there are so many scenes. */
  private async load(count: number): Promise<void> {
    const text = this.wanted;
    let scenes: Schemas["Scene"][] = [];
    let after: string | null = null;
    do {
      const page: Schemas["SceneList"] = await load(text, after);
      scenes = scenes.concat(page.items);
      after = page.next;
    } while (after !== null && scenes.length < count);
    if (text === this.wanted) this.show(text, scenes, after); // else another search has begun
  }

  private show(text: string, scenes: readonly Schemas["Scene"][], next: string | null): void {
    this.searched.value = text;
    this.scenes.value = scenes;
    this.next = next;
    this.hasMore.value = next !== null;
  }
}

function load(text: string, after: string | null): Promise<Schemas["SceneList"]> {
  const query = {
    limit: PAGE,
    ...(text ? { search: text } : {}),
    ...(after === null ? {} : { after }),
  };
  return data(api.GET("/v1/scenes", { params: { query } }));
}
