import { computed, signal } from "@preact/signals";
import { ServiceError } from "../api/problem";
import type { Schemas } from "../api/service";
import { strings } from "../strings";
import type { PickedFile } from "./picked-files";

/** How the service judges an image. */
export type Judgement = Pick<Schemas["Image"], "verdict" | "reason" | "hint">;

/** What the queue needs of the service, for one scene. All throw `ServiceError`. */
export interface UploadService {
  /** The image's digest, `sha256:…`; throws `UnreadableFile`. */
  digest(file: File): Promise<string>;
  /** The judgement of an image that the scene has; null when it does not have it. */
  known(digest: string): Promise<Judgement | null>;
  sendSubtitles(digest: string, file: File, signal: AbortSignal): Promise<void>;
  send(digest: string, file: File, onSent: (bytes: number) => void, signal: AbortSignal): Promise<Judgement>;
}

/** A file that can no longer be read, because it was moved or changed. */
export class UnreadableFile extends Error {
  override name = "UnreadableFile";
  readonly hint = strings.photographs.upload.unreadableHint;

  constructor() {
    super(strings.photographs.upload.unreadable);
  }
}

export type UploadState = "waiting" | "checking" | "sending" | "pausing" | "known" | "sent" | "failed";

/** A file on its way to the service. */
export interface Upload extends PickedFile {
  id: number;
  state: UploadState;
  sentBytes: number;
  /** How the service judges it; null until it has arrived. */
  judgement: Judgement | null;
  /** Why it failed or pauses; null while all is well. */
  problem: ServiceError | UnreadableFile | null;
}

const AT_ONCE = 3;
const LONGEST_PAUSE_S = 30;
const OTHER_TRIES = 3;
const RATE_WINDOW_MS = 30_000;
/** Refusals that would meet every other file, too. */
const FOR_ALL = new Set(["unauthenticated", "forbidden", "not-found", "conflict", "foreign-origin"]);
const OPEN: readonly UploadState[] = ["waiting", "checking", "sending", "pausing"];

/** How fast something goes on, by its last half minute. */
class Rate {
  private samples: { at: number; total: number }[] = [];

  /** Note a total at a time in ms. */
  add(total: number, at: number): void {
    this.samples.push({ at, total });
    while (this.samples.length > 2 && (this.samples[1]?.at ?? at) < at - RATE_WINDOW_MS) this.samples.shift();
  }

  /** The increase per s; null while it is not known. */
  perSecond(): number | null {
    const first = this.samples[0];
    const last = this.samples.at(-1);
    if (!first || !last || last.at - first.at < 500) return null;
    return ((last.total - first.total) / (last.at - first.at)) * 1000;
  }
}

/** Sends files to a scene, a few at once, and goes on after interruptions. */
export class UploadQueue {
  readonly uploads = signal<readonly Upload[]>([]);
  readonly totals = computed(() => totalsOf(this.uploads.value));
  /** Bytes and files per s; null while they are not known. */
  readonly speed = signal<{ bytes: number | null; files: number | null }>({ bytes: null, files: null });

  private aborter = new AbortController();
  private bytes = new Rate();
  private files = new Rate();
  private running = 0;
  private next = 1;

  constructor(
    private readonly service: UploadService,
    private readonly wait: (ms: number, signal: AbortSignal) => Promise<void> = pause,
    private readonly now: () => number = Date.now,
  ) {}

  /** Send files after those that wait. */
  add(files: readonly PickedFile[]): void {
    if (this.totals.value.open === 0) {
      this.bytes = new Rate();
      this.files = new Rate();
    }
    const added = files.map((one): Upload => ({ ...one, ...FRESH, id: this.next++ }));
    this.uploads.value = [...this.uploads.value, ...added];
    this.measure();
    this.start();
  }

  /** Send the files again that failed. */
  retryFailed(): void {
    this.uploads.value = this.uploads.value.map((one) =>
      one.state === "failed" ? { ...one, ...FRESH } : one,
    );
    this.start();
  }

  /** Stop sending; what has arrived stays in the scene. */
  cancel(): void {
    this.aborter.abort();
    this.aborter = new AbortController();
    this.uploads.value = this.uploads.value.filter((one) => !OPEN.includes(one.state));
  }

  /** Forget the files that are not on their way. */
  clear(): void {
    this.uploads.value = this.uploads.value.filter((one) => OPEN.includes(one.state));
  }

  private start(): void {
    while (this.running < AT_ONCE && this.uploads.value.some((one) => one.state === "waiting")) {
      this.running++;
      void this.work(this.aborter.signal).finally(() => {
        this.running--;
        if (this.uploads.value.some((one) => one.state === "waiting")) this.start();
      });
    }
  }

  private async work(signal: AbortSignal): Promise<void> {
    for (;;) {
      const upload = this.uploads.value.find((one) => one.state === "waiting");
      if (!upload || signal.aborted) return;
      this.change(upload.id, { state: "checking" });
      await this.sendWithRetries(upload, signal);
      this.measure();
    }
  }

  private async sendWithRetries(upload: Upload, signal: AbortSignal): Promise<void> {
    for (let failures = 0; ; failures++) {
      try {
        await this.send(upload, signal);
        return;
      } catch (error) {
        if (signal.aborted) return;
        const pauseS = pauseAfter(error, failures);
        if (pauseS === null) {
          this.fail(upload, error as ServiceError | UnreadableFile);
          return;
        }
        this.change(upload.id, { state: "pausing", problem: error as ServiceError });
        await this.wait(pauseS * 1000, signal).catch(() => undefined);
        if (signal.aborted) return;
      }
    }
  }

  private async send({ id, file, subtitles }: Upload, signal: AbortSignal): Promise<void> {
    this.change(id, { state: "checking", problem: null });
    const digest = await this.service.digest(file);
    const known = await this.service.known(digest);
    if (signal.aborted) return;
    if (known) {
      this.change(id, { state: "known", sentBytes: file.size, judgement: known });
      return;
    }
    if (subtitles) await this.service.sendSubtitles(digest, subtitles, signal);
    this.change(id, { state: "sending" });
    const onSent = (bytes: number) => {
      this.change(id, { sentBytes: Math.min(bytes, file.size) });
      this.measure();
    };
    const judgement = await this.service.send(digest, file, onSent, signal);
    this.change(id, { state: "sent", sentBytes: file.size, judgement });
  }

  private fail(upload: Upload, problem: ServiceError | UnreadableFile): void {
    this.change(upload.id, { state: "failed", problem, sentBytes: 0 });
    if (problem instanceof ServiceError && FOR_ALL.has(problem.code)) {
      this.uploads.value = this.uploads.value.map((one) =>
        one.state === "waiting" ? { ...one, state: "failed", problem } : one,
      );
    }
  }

  private change(id: number, to: Partial<Upload>): void {
    this.uploads.value = this.uploads.value.map((one) => (one.id === id ? { ...one, ...to } : one));
  }

  private measure(): void {
    const { sentBytes, done } = this.totals.value;
    this.bytes.add(sentBytes, this.now());
    this.files.add(done, this.now());
    this.speed.value = { bytes: this.bytes.perSecond(), files: this.files.perSecond() };
  }
}

const FRESH = { state: "waiting", sentBytes: 0, judgement: null, problem: null } as const;

/** The uploads as a whole. */
export interface Totals {
  files: number;
  open: number;
  done: number;
  failed: number;
  bytes: number;
  sentBytes: number;
}

function totalsOf(uploads: readonly Upload[]): Totals {
  const counted = uploads.filter((one) => one.state !== "failed");
  const open = counted.filter((one) => OPEN.includes(one.state)).length;
  return {
    files: uploads.length,
    open,
    done: counted.length - open,
    failed: uploads.length - counted.length,
    bytes: counted.reduce((sum, one) => sum + one.file.size, 0),
    sentBytes: counted.reduce((sum, one) => sum + one.sentBytes, 0),
  };
}

/** How long to wait, in s, before a file is sent again; null when that would not help. */
export function pauseAfter(error: unknown, failures: number): number | null {
  if (!(error instanceof ServiceError)) return null;
  const backOff = Math.min(2 ** failures, LONGEST_PAUSE_S);
  if (error.code === "out-of-space") return LONGEST_PAUSE_S;
  if ([0, 408, 423, 429, 502, 503, 504].includes(error.status)) return error.retryAfterS ?? backOff;
  if (error.status >= 500 || error.code === "digest-mismatch" || error.code === "offset-mismatch") {
    return failures + 1 < OTHER_TRIES ? backOff : null;
  }
  return null;
}

function pause(ms: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    const timer = setTimeout(resolve, ms);
    signal.addEventListener("abort", () => {
      clearTimeout(timer);
      reject(signal.reason);
    });
  });
}
