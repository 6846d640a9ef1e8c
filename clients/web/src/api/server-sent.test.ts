import { describe, expect, it } from "vitest";
import { parse, serverSent } from "./server-sent";

describe("blocks of a stream", () => {
  it("have a position, a name and data", () => {
    expect(parse('id: 7\nevent: job.progress\ndata: {"number":7}')).toEqual({
      id: "7",
      event: "job.progress",
      data: '{"number":7}',
    });
  });

  it("may have a position alone, or be a comment", () => {
    expect(parse("retry: 1000\nid: 3")).toEqual({ id: "3", event: "message", data: "" });
    expect(parse(": heartbeat")).toEqual({ id: null, event: "message", data: "" });
  });
});

it("A message that arrives in pieces is one message", async () => {
  const pieces = ["data: a", "b\n\nda", "ta: c\n", "\ndata: never ended"];
  const body = new ReadableStream<Uint8Array>({
    start(controller) {
      for (const piece of pieces) controller.enqueue(new TextEncoder().encode(piece));
      controller.close();
    },
  });
  const got: string[] = [];
  for await (const message of serverSent(new Response(body))) got.push(message.data);
  expect(got).toEqual(["ab", "c"]);
});
