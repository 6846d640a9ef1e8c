import { signal } from "@preact/signals";
import { ServiceError } from "../api/problem";
import { strings } from "../strings";

/** A sentence for the operator that stays until it is closed. */
export interface Notice {
  id: number;
  kind: "error" | "warning" | "success";
  message: string;
  hint: string;
}

export const notices = signal<readonly Notice[]>([]);

let next = 1;

/** Show a notice; one that is already shown is not repeated. */
export function notify(kind: Notice["kind"], message: string, hint = ""): void {
  if (notices.value.some((one) => one.message === message)) return;
  notices.value = [...notices.value, { id: next++, kind, message, hint }];
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
  notify("error", error instanceof Error ? error.message : String(error), strings.unexpectedHint);
}
