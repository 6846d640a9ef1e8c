import { bytes } from "../api/service";

/**
 * Save what the service has at a path as a file.
 *
 * A link alone could not send the key, so the file is fetched first. Throws `ServiceError`.
 */
export async function download(path: string, filename: string): Promise<void> {
  saveAs(await bytes(path), filename);
}

/** Save bytes that the page has as a file. */
export function saveAs(content: Blob, filename: string): void {
  const url = URL.createObjectURL(content);
  const link = document.createElement("a");
  link.href = url;
  link.download = filename;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000); // the browser reads it after the click
}
