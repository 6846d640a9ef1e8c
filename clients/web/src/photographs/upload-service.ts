import { imagePath } from "../api/paths";
import { sendFile } from "../api/send-file";
import { api, data, send } from "../api/service";
import { Digests } from "./sha256";
import { type Judgement, UnreadableFile, type UploadService } from "./upload-queue";

/** Files from here on are sent by the protocol that goes on where it broke off. */
const RESUMED_BYTES = 16 << 20;
const TUS = { "Tus-Resumable": "1.0.0" };
const BINARY = "application/octet-stream";

let digests: Digests | null = null;

/** The uploads of one scene, over REST. */
export class SceneUploads implements UploadService {
  constructor(private readonly sceneId: string) {}

  async digest(file: File): Promise<string> {
    digests ??= new Digests();
    const digest = await digests.of(file);
    if (digest === null) throw new UnreadableFile();
    return `sha256:${digest}`;
  }

  async known(digest: string): Promise<Judgement | null> {
    const answer = await data(
      api.POST("/v1/scenes/{scene_id}/images:check", {
        params: { path: { scene_id: this.sceneId } },
        body: { digests: [digest] },
      }),
    );
    return answer.images[0] ?? null;
  }

  async sendSubtitles(digest: string, file: File, signal: AbortSignal): Promise<void> {
    const path = imagePath(this.sceneId, digest, "subtitles");
    const headers = { "Content-Type": BINARY };
    await sendFile({ method: "PUT", path, body: file, headers, onSent: () => undefined, signal });
  }

  async send(
    digest: string,
    file: File,
    onSent: (bytes: number) => void,
    signal: AbortSignal,
  ): Promise<Judgement> {
    if (file.size >= RESUMED_BYTES) return this.resume(digest, file, onSent, signal);
    const path = `${imagePath(this.sceneId, digest)}?name=${encodeURIComponent(file.name)}`;
    const headers = { "Content-Type": BINARY };
    const response = await sendFile({ method: "PUT", path, body: file, headers, onSent, signal });
    return (await response.json()) as Judgement;
  }

  /** Send a large file from where an earlier try broke off. */
  private async resume(
    digest: string,
    file: File,
    onSent: (bytes: number) => void,
    signal: AbortSignal,
  ): Promise<Judgement> {
    const metadata = { scene: this.sceneId, sha256: digest.slice("sha256:".length), filename: file.name };
    const created = await send("/v1/uploads", {
      method: "POST",
      headers: {
        ...TUS,
        "Upload-Length": String(file.size),
        "Upload-Metadata": Object.entries(metadata)
          .map(([name, value]) => `${name} ${base64(value)}`)
          .join(","),
      },
      signal,
    });
    const offset = Number(created.headers.get("Upload-Offset"));
    onSent(offset);
    if (offset < file.size) {
      const path = created.headers.get("Location") ?? "";
      const headers = {
        ...TUS,
        "Upload-Offset": String(offset),
        "Content-Type": "application/offset+octet-stream",
      };
      await sendFile({
        method: "PATCH",
        path,
        body: file.slice(offset),
        headers,
        onSent: (bytes) => onSent(offset + bytes),
        signal,
      });
    }
    return (await (await send(imagePath(this.sceneId, digest), { signal })).json()) as Judgement;
  }
}

function base64(text: string): string {
  return btoa(String.fromCharCode(...new TextEncoder().encode(text)));
}
