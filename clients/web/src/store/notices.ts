import { signal } from "@preact/signals";
import { ServiceError, type Words, wordsOf } from "../api/problem";
import { strings } from "../strings";

/** How long a success is shown; what needs a reaction stays until it is closed. */
const SUCCESS_MS = 8000;

/** A sentence for the operator. */
export interface Notice extends Words {
  id: number;
  kind: "error" | "warning" | "success";
}

export const notices = signal<readonly Notice[]>([]);

let next = 1;

/** Show a notice; one that is already shown is not repeated. */
export function notify(kind: Notice["kind"], message: string, hint = ""): void {
  if (notices.value.some((one) => one.message === message)) return;
  const id = next++;
  notices.value = [...notices.value, { id, kind, message, hint }];
  if (kind === "success") setTimeout(() => dismiss(id), SUCCESS_MS);
}

export function dismiss(id: number): void {
  notices.value = notices.value.filter((one) => one.id !== id);
}

/** Show what went wrong; a refusal of the key has a dialog of its own. */
export function report(error: unknown): void {
  if (error instanceof DOMException && error.name === "AbortError") return;
  if (error instanceof ServiceError) {
    if (error.status !== 401) notify("error", error.message, error.hint);
    return;
  }
  console.error(error);
  notify("error", wordsOf(error).message, strings.unexpectedHint);
}
