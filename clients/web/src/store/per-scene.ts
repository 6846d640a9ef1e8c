import type { SceneStore } from "./scene";

/** State of a panel that outlives it: it stays as long as the page shows the scene. */
export function perScene<T>(make: (store: SceneStore) => T): (store: SceneStore) => T {
  const made = new WeakMap<SceneStore, T>();
  return (store) => {
    let state = made.get(store);
    if (state === undefined) {
      state = make(store);
      made.set(store, state);
    }
    return state;
  };
}
