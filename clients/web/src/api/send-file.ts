import { strings } from "../strings";
import { apiKey } from "./key";
import { errorOf, ServiceError } from "./problem";

/** A request whose body is a file. */
export interface FileRequest {
  method: "PUT" | "PATCH";
  /** Its path on the service. */
  path: string;
  body: Blob;
  headers: Record<string, string>;
  /** Called with the number of bytes that are sent. */
  onSent: (bytes: number) => void;
  signal: AbortSignal;
}

/**
 * Send a file, with the session's key.
 *
 * It is an `XMLHttpRequest`, since `fetch` does not tell how much of a body is sent. Throws `ServiceError`, and
 * `AbortError` when the signal ends it.
 */
export function sendFile({ method, path, body, headers, onSent, signal }: FileRequest): Promise<Response> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    const abort = () => request.abort();
    signal.throwIfAborted();
    signal.addEventListener("abort", abort);
    request.open(method, path);
    for (const [name, value] of Object.entries(headers)) request.setRequestHeader(name, value);
    if (apiKey.value !== null) request.setRequestHeader("Authorization", `Bearer ${apiKey.value}`);
    request.upload.onprogress = (event) => onSent(event.loaded);
    request.onabort = () => reject(new DOMException("", "AbortError"));
    request.onerror = () => reject(new ServiceError(strings.noAnswer, strings.noAnswerHint, "network", 0));
    request.onload = async () => {
      const retryAfter = request.getResponseHeader("Retry-After");
      const response = new Response(request.responseText || null, {
        status: request.status,
        headers: retryAfter === null ? {} : { "Retry-After": retryAfter },
      });
      if (response.ok) resolve(response);
      else reject(await errorOf(response));
    };
    request.onloadend = () => signal.removeEventListener("abort", abort);
    request.send(body);
  });
}
