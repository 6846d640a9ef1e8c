import createClient from "openapi-fetch";
import { strings } from "../strings";
import { apiKey, keyRefusal } from "./key";
import { errorOf, ServiceError } from "./problem";
import type { components, paths } from "./schema";

export type Schemas = components["schemas"];

/** Send a request with the session's key. Throws `ServiceError`, also when there is no answer. */
export async function send(input: Request | string, init?: RequestInit): Promise<Response> {
  const request = new Request(input, init);
  if (apiKey.value !== null) request.headers.set("Authorization", `Bearer ${apiKey.value}`);
  let response: Response;
  try {
    response = await fetch(request);
  } catch (cause) {
    if (request.signal.aborted) throw cause;
    throw new ServiceError(strings.noAnswer, strings.noAnswerHint, "network", 0);
  }
  if (response.ok || response.status === 304) return response;
  const error = await errorOf(response);
  if (error.status === 401) keyRefusal.value = { message: error.message, hint: error.hint };
  throw error;
}

/** The service's operations by path, typed by its OpenAPI document. They throw `ServiceError`. */
export const api = createClient<paths>({ baseUrl: location.origin, fetch: send });

/** The JSON of an answer of `api`. */
export async function data<T>(answer: Promise<{ data?: T | undefined }>): Promise<T> {
  return (await answer).data as T;
}

interface Page<T> {
  items: T[];
  next: string | null;
}

/** All items of a list that comes in pages. */
export async function all<T>(page: (after: string | undefined) => Promise<Page<T>>): Promise<T[]> {
  const items: T[] = [];
  let after: string | undefined;
  do {
    const got = await page(after);
    items.push(...got.items);
    after = got.next ?? undefined;
  } while (after !== undefined);
  return items;
}

/** The bytes at a path, such as an image or an artifact. */
export async function bytes(path: string, signal?: AbortSignal): Promise<Blob> {
  return (await send(path, signal ? { signal } : {})).blob();
}
