import { type Words, wordsOf } from "../api/problem";
import type { Upload } from "./upload-queue";

/** The names of files that failed, for each reason. */
export function byProblem(failures: readonly Upload[]): (Words & { names: string[] })[] {
  const found = new Map<string, Words & { names: string[] }>();
  for (const { problem, file } of failures) {
    if (problem === null) continue;
    const words = wordsOf(problem);
    const known = found.get(words.message) ?? { ...words, names: [] };
    known.names.push(file.name);
    found.set(words.message, known);
  }
  return [...found.values()];
}
