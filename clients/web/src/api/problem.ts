import type { components } from "./schema";

export type Problem = components["schemas"]["Problem"];

/** A request that the service refused, or that did not reach it. */
export class ServiceError extends Error {
  override name = "ServiceError";

  constructor(
    message: string,
    /** What to do about it; may be empty. */
    readonly hint: string,
    /** The problem's code, or `network` when there was no answer. */
    readonly code: string,
    /** The HTTP status; 0 when there was no answer. */
    readonly status: number,
    /** When to try again, in s; null when the service does not say. */
    readonly retryAfterS: number | null = null,
  ) {
    super(message);
  }
}

/** What went wrong, and what to do about it; the hint may be empty. */
export interface Words {
  message: string;
  hint: string;
}

/** The words for an error, of the service or another. */
export function wordsOf(error: unknown): Words {
  if (!(error instanceof Error)) return { message: String(error), hint: "" };
  return { message: error.message, hint: "hint" in error ? String(error.hint) : "" };
}

/** The error that a problem describes. */
export function refusal(problem: Problem, retryAfterS: number | null): ServiceError {
  const fields = (problem.errors ?? []).map((one) => `${one.field}: ${one.message}`).join("; ");
  const message = fields ? `${problem.detail} ${fields}` : problem.detail;
  return new ServiceError(message, problem.hint, problem.code, problem.status, retryAfterS);
}

/** The error that a response without success describes. */
export async function errorOf(response: Response): Promise<ServiceError> {
  const retryAfter = response.headers.get("Retry-After");
  const retryAfterS = retryAfter !== null && /^\d+$/.test(retryAfter) ? Number(retryAfter) : null;
  const problem = (await response.json().catch(() => null)) as Problem | null;
  if (problem?.detail) return refusal(problem, retryAfterS);
  const { status } = response;
  return new ServiceError(`The answer has status ${status}.`, "", "unknown", status, retryAfterS);
}
