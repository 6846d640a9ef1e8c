import type { components } from "./schema";
import { serverSent } from "./server-sent";
import { send } from "./service";

export type SceneEvent = components["schemas"]["Event"];

/** What arrives on a stream: its position, an event, or nothing for some time. */
export type Message = { id: string | null; event: SceneEvent | null };

/**
 * The events of a scene that follow `after`, or only new ones.
 *
 * The first message has the position of the stream. Ends when the connection ends. Throws `ServiceError`.
 */
export async function* sceneEvents(
  sceneId: string,
  after: string | null,
  signal: AbortSignal,
): AsyncGenerator<Message> {
  const headers: Record<string, string> = { Accept: "text/event-stream" };
  if (after !== null) headers["Last-Event-ID"] = after;
  const response = await send(`/v1/scenes/${sceneId}/events?tail=true`, {
    headers,
    signal,
    cache: "no-store",
  });
  for await (const { id, data } of serverSent(response)) {
    yield { id, event: data ? (JSON.parse(data) as SceneEvent) : null };
  }
}
