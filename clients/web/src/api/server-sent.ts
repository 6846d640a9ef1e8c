/** One message of a stream of server-sent events; `data` is empty in a comment. */
export interface ServerSent {
  id: string | null;
  event: string;
  data: string;
}

/** The messages of a response, until it ends (WHATWG HTML, section 9.2). */
export async function* serverSent(response: Response): AsyncGenerator<ServerSent> {
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

/** The message of one block. */
export function parse(block: string): ServerSent {
  const message: ServerSent = { id: null, event: "message", data: "" };
  const lines: string[] = [];
  for (const line of block.split("\n")) {
    if (line.startsWith("id:")) message.id = line.slice(3).trim();
    else if (line.startsWith("event:")) message.event = line.slice(6).trim();
    else if (line.startsWith("data:")) lines.push(line.slice(5).trimStart());
  }
  message.data = lines.join("\n");
  return message;
}
