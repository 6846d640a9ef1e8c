import { describe, expect, it } from "vitest";
import { parse } from "./events";

describe("blocks of the stream", () => {
  it("have a position and an event", () => {
    expect(parse('id: 7\nevent: job.progress\ndata: {"number":7}')).toEqual({
      id: "7",
      event: { number: 7 },
    });
  });

  it("may have a position alone, or be a comment", () => {
    expect(parse("retry: 1000\nid: 3")).toEqual({ id: "3", event: null });
    expect(parse(": heartbeat")).toEqual({ id: null, event: null });
  });
});
