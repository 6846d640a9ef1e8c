import { expect, it } from "vitest";
import { picked } from "./picked-files";

function found(...paths: string[]) {
  return paths.map((path) => ({ path, file: new File([], path.slice(path.lastIndexOf("/") + 1)) }));
}

it("sends photographs and videos, and names what it leaves out", () => {
  const { files, others } = picked(found("a/1.JPG", "a/notes.txt", "a/.DS_Store", "b/2.tif", "b/lone.srt"));
  expect(files.map(({ file }) => file.name)).toEqual(["1.JPG", "2.tif"]);
  expect(others).toEqual(["notes.txt", "lone.srt"]);
});

it("sends the subtitles that lie beside a video", () => {
  const { files, others } = picked(found("a/DJI_1.SRT", "a/DJI_1.MP4", "b/DJI_1.mp4"));
  expect(files.map(({ subtitles }) => subtitles?.name)).toEqual(["DJI_1.SRT", undefined]);
  expect(others).toEqual([]);
});
