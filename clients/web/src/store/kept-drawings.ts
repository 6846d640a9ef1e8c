import { effect, type Signal, signal } from "@preact/signals";
import type { Drawing } from "./scene";
import { stored } from "./stored";

/** The drawings of a scene; they stay until the tab is closed, also when the page is loaded again. */
export function keptDrawings(sceneId: string): Signal<readonly Drawing[]> {
  const name = `fvs-drawings-${sceneId}`;
  const drawings = signal(stored<readonly Drawing[]>(sessionStorage, name, []));
  effect(() => {
    if (drawings.value.length > 0) sessionStorage.setItem(name, JSON.stringify(drawings.value));
    else sessionStorage.removeItem(name);
  });
  return drawings;
}
