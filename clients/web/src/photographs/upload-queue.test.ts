import { describe, expect, it } from "vitest";
import { ServiceError } from "../api/problem";
import { type Judgement, pauseAfter, UnreadableFile, UploadQueue, type UploadService } from "./upload-queue";

const ACCEPTED: Judgement = { verdict: "accepted", reason: "", hint: "" };

function refusal(status: number, code = "any", retryAfterS: number | null = null) {
  return new ServiceError("No.", "", code, status, retryAfterS);
}

function file(name: string, bytes = 10) {
  return { file: new File(["x".repeat(bytes)], name), subtitles: null };
}

/** A service that answers with `refusals`, one for each request, and then accepts. */
class FakeService implements UploadService {
  sent: string[] = [];
  subtitles: string[] = [];
  most = 0;
  private open = 0;

  constructor(
    private readonly refusals: Error[] = [],
    private readonly has: string[] = [],
  ) {}

  async digest(one: File) {
    if (one.name === "gone.jpg") throw new UnreadableFile();
    return one.name;
  }
  async known(digest: string) {
    return this.has.includes(digest) ? ACCEPTED : null;
  }
  async sendSubtitles(digest: string) {
    this.subtitles.push(digest);
  }
  async send(digest: string, one: File, onSent: (bytes: number) => void) {
    this.most = Math.max(this.most, ++this.open);
    await Promise.resolve();
    this.open--;
    onSent(one.size / 2);
    const refused = this.refusals.shift();
    if (refused) throw refused;
    this.sent.push(digest);
    return ACCEPTED;
  }
}

function queueOf(service: UploadService) {
  const waits: number[] = [];
  const queue = new UploadQueue(service, async (ms) => void waits.push(ms));
  const end = async () => {
    while (queue.totals.value.open > 0) await new Promise((resolve) => setTimeout(resolve));
  };
  return { queue, waits, end };
}

describe("a queue of uploads", () => {
  it("sends three at once, and spares what the service has", async () => {
    const service = new FakeService([], ["1.jpg"]);
    const { queue, end } = queueOf(service);
    queue.add(["0.jpg", "1.jpg", "2.jpg", "3.jpg", "4.jpg", "5.jpg"].map((name) => file(name)));
    await end();
    expect(service.sent.sort()).toEqual(["0.jpg", "2.jpg", "3.jpg", "4.jpg", "5.jpg"]);
    expect(service.most).toBeLessThanOrEqual(3);
    expect(queue.uploads.value.find((one) => one.file.name === "1.jpg")?.state).toBe("known");
    expect(queue.totals.value).toMatchObject({ files: 6, done: 6, failed: 0, bytes: 60, sentBytes: 60 });
  });

  it("tries again after broken connections, and as long as the service says", async () => {
    const service = new FakeService([refusal(0), refusal(0), refusal(503, "unavailable", 7)]);
    const { queue, waits, end } = queueOf(service);
    queue.add([file("a.jpg")]);
    await end();
    expect(service.sent).toEqual(["a.jpg"]);
    expect(waits).toEqual([1000, 2000, 7000]);
  });

  it("sends the others when one is refused", async () => {
    const service = new FakeService([refusal(413, "payload-too-large")]);
    const { queue, end } = queueOf(service);
    queue.add([file("a.jpg"), file("gone.jpg"), file("b.jpg")]);
    await end();
    expect(queue.totals.value).toMatchObject({ done: 1, failed: 2 });
    queue.retryFailed();
    await end();
    expect(queue.uploads.value.map((one) => one.state)).toEqual(["sent", "failed", "sent"]);
  });

  it("does not ask for every file what is refused for all", async () => {
    const refusals = Array.from({ length: 9 }, () => refusal(403, "forbidden"));
    const { queue, end } = queueOf(new FakeService(refusals));
    queue.add(Array.from({ length: 9 }, (_, i) => file(`${i}.jpg`)));
    await end();
    expect(queue.totals.value.failed).toBe(9);
    expect(refusals.length).toBeGreaterThanOrEqual(6);
  });

  it("sends subtitles before their video", async () => {
    const service = new FakeService();
    const { queue, end } = queueOf(service);
    queue.add([{ ...file("a.mp4"), subtitles: new File([], "a.srt") }]);
    await end();
    expect(service.subtitles).toEqual(["a.mp4"]);
  });

  it("stops when it is cancelled, and starts again", async () => {
    const service = new FakeService();
    const { queue, end } = queueOf(service);
    queue.add([file("a.jpg"), file("b.jpg")]);
    queue.cancel();
    expect(queue.totals.value).toMatchObject({ files: 0, open: 0 });
    queue.add([file("c.jpg")]);
    await end();
    expect(queue.uploads.value.map((one) => [one.file.name, one.state])).toEqual([["c.jpg", "sent"]]);
  });
});

it("waits for what passes, and gives up what does not", () => {
  expect(pauseAfter(refusal(0), 0)).toBe(1);
  expect(pauseAfter(refusal(0), 20)).toBe(30);
  expect(pauseAfter(refusal(429, "limit-exceeded", 3), 0)).toBe(3);
  expect(pauseAfter(refusal(507, "out-of-space"), 0)).toBe(30);
  expect(pauseAfter(refusal(500, "internal"), 2)).toBeNull();
  expect(pauseAfter(refusal(415), 0)).toBeNull();
});
