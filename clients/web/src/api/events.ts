import type { components } from "./schema";
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
  const reader = (response.body as ReadableStream<Uint8Array>)
    .pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array>)
    .getReader();
  let buffer = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    buffer += value;
    const blocks = buffer.split("\n\n");
    buffer = blocks.pop() ?? "";
    for (const block of blocks) yield parse(block);
  }
}

/** One block of a stream of server-sent events (WHATWG HTML, section 9.2). */
export function parse(block: string): Message {
  let id: string | null = null;
  const lines: string[] = [];
  for (const line of block.split("\n")) {
    if (line.startsWith("id:")) id = line.slice(3).trim();
    else if (line.startsWith("data:")) lines.push(line.slice(5).trimStart());
  }
  return { id, event: lines.length ? (JSON.parse(lines.join("\n")) as SceneEvent) : null };
}
