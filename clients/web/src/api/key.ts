import { signal } from "@preact/signals";
import type { Words } from "./problem";

const NAME = "fvs-api-key";

/** The API key of this browser session; it is kept neither in a URL nor in local storage. */
export const apiKey = signal<string | null>(sessionStorage.getItem(NAME));

/** Why a key is asked for: the service's last refusal; null while none is needed. */
export const keyRefusal = signal<Words | null>(null);

/** Use a key from now on; null forgets it. */
export function setKey(key: string | null): void {
  if (key === null) sessionStorage.removeItem(NAME);
  else sessionStorage.setItem(NAME, key);
  apiKey.value = key;
  keyRefusal.value = null;
}
