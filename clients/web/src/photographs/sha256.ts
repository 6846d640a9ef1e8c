/** What the worker is asked. */
export interface DigestQuestion {
  id: number;
  file: Blob;
}

/** What it answers: 64 hexadecimal digits, or null when the file cannot be read. */
export interface DigestAnswer {
  id: number;
  digest: string | null;
}

/** The SHA-256 of files, computed beside the page. */
export class Digests {
  private readonly worker = new Worker(new URL("./sha256.worker.ts", import.meta.url), { type: "module" });
  private readonly waiting = new Map<number, (digest: string | null) => void>();
  private next = 0;

  constructor() {
    this.worker.addEventListener("message", ({ data }: MessageEvent<DigestAnswer>) => {
      this.waiting.get(data.id)?.(data.digest);
      this.waiting.delete(data.id);
    });
  }

  /** 64 hexadecimal digits; null when the file cannot be read. */
  of(file: Blob): Promise<string | null> {
    const question: DigestQuestion = { id: this.next++, file };
    this.worker.postMessage(question);
    return new Promise((resolve) => this.waiting.set(question.id, resolve));
  }
}
