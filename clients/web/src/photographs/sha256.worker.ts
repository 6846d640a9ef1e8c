import { sha256 } from "@noble/hashes/sha2.js";
import { bytesToHex } from "@noble/hashes/utils.js";
import type { DigestAnswer, DigestQuestion } from "./sha256";

const BLOCK_BYTES = 4 << 20;
const AT_ONCE_BYTES = 64 << 20;

/** The browser's own SHA-256 takes whole files, and only pages over https or of this computer have it. */
async function digestOf(file: Blob): Promise<string> {
  if (crypto.subtle && file.size <= AT_ONCE_BYTES) {
    return bytesToHex(new Uint8Array(await crypto.subtle.digest("SHA-256", await file.arrayBuffer())));
  }
  const hash = sha256.create();
  for (let start = 0; start < file.size; start += BLOCK_BYTES) {
    hash.update(new Uint8Array(await file.slice(start, start + BLOCK_BYTES).arrayBuffer()));
  }
  return bytesToHex(hash.digest());
}

addEventListener("message", async ({ data }: MessageEvent<DigestQuestion>) => {
  const answer: DigestAnswer = { id: data.id, digest: await digestOf(data.file).catch(() => null) };
  postMessage(answer);
});
