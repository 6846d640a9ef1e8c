import { expect, it } from "vitest";
import { ServiceError } from "../api/problem";
import { byProblem } from "./upload-problems";
import { UnreadableFile, type Upload } from "./upload-queue";

it("says each reason once", () => {
  const failed = (name: string, problem: Upload["problem"]) =>
    ({ file: new File([], name), problem }) as Upload;
  const refused = new ServiceError("This needs another key.", "Create one.", "forbidden", 403);
  const found = byProblem([failed("a", refused), failed("b", new UnreadableFile()), failed("c", refused)]);
  expect(found.map(({ names }) => names)).toEqual([["a", "c"], ["b"]]);
  expect(found[0]).toMatchObject({ message: "This needs another key.", hint: "Create one." });
});
