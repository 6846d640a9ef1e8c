/** A file to send, with the subtitles of a drone's video. */
export interface PickedFile {
  file: File;
  subtitles: File | null;
}

/** What was chosen: files to send, and the names of others, which are not sent. */
export interface Picked {
  files: PickedFile[];
  others: string[];
}

const IMAGES = ["jpg", "jpeg", "mpo", "png", "tif", "tiff", "webp", "bmp", "heic", "heif", "dng"];
const VIDEOS = ["mp4", "mov", "m4v", "mkv", "webm", "avi", "mts", "m2ts"];

/** What file choosers offer. */
export const ACCEPTED = [...IMAGES, ...VIDEOS, "srt"].map((end) => `.${end}`).join(",");

/** Sort files, with their paths, into what is sent and what is not; an .SRT goes with the video beside it. */
export function picked(found: readonly { path: string; file: File }[]): Picked {
  const visible = found.filter(({ file }) => !file.name.startsWith("."));
  const subtitles = new Map<string, File>();
  for (const { path, file } of visible) {
    if (endOf(file.name) === "srt") subtitles.set(stemOf(path), file);
  }
  const files: PickedFile[] = [];
  const others: string[] = [];
  for (const { path, file } of visible) {
    const end = endOf(file.name);
    const beside = VIDEOS.includes(end) ? (subtitles.get(stemOf(path)) ?? null) : null;
    if (beside) subtitles.delete(stemOf(path));
    if (IMAGES.includes(end) || VIDEOS.includes(end)) files.push({ file, subtitles: beside });
    else if (end !== "srt") others.push(file.name);
  }
  return { files, others: [...others, ...[...subtitles.values()].map((file) => file.name)] };
}

/** The files of a file chooser, which may be those of a folder. */
export function chosen(list: FileList): Picked {
  return picked([...list].map((file) => ({ path: file.webkitRelativePath || file.name, file })));
}

/** The files that were dropped, those in folders included. */
export async function dropped(transfer: DataTransfer): Promise<Picked> {
  const items = [...transfer.items].filter((item) => item.kind === "file");
  const dragged = items.map((item) => item.webkitGetAsEntry() ?? item.getAsFile()); // before the event ends
  const found: { path: string; file: File }[] = [];
  for (const one of dragged) {
    if (one instanceof File) found.push({ path: one.name, file: one });
    else if (one) await collect(one, found);
  }
  return picked(found);
}

async function collect(entry: FileSystemEntry, found: { path: string; file: File }[]): Promise<void> {
  if (entry.isFile) {
    const file = await new Promise<File>((resolve, reject) =>
      (entry as FileSystemFileEntry).file(resolve, reject),
    );
    found.push({ path: entry.fullPath, file });
    return;
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  for (;;) {
    const some = await new Promise<FileSystemEntry[]>((resolve, reject) =>
      reader.readEntries(resolve, reject),
    );
    if (some.length === 0) return; // browsers give at most a hundred at a time
    for (const one of some) await collect(one, found);
  }
}

function endOf(name: string): string {
  return name.slice(name.lastIndexOf(".") + 1).toLowerCase();
}

function stemOf(path: string): string {
  return path.slice(0, path.lastIndexOf(".")).toLowerCase();
}
