import { ServiceError } from "../api/problem";
import { strings } from "../strings";
import type { Upload } from "./upload-queue";

/** What is wrong, and what to do about it. */
interface Words {
  message: string;
  hint: string;
}

/** The words for why a file fails or pauses. */
export function wordsOf(problem: NonNullable<Upload["problem"]>): Words {
  if (problem instanceof ServiceError) return { message: problem.message, hint: problem.hint };
  const { unreadable, unreadableHint } = strings.photographs.upload;
  return { message: unreadable, hint: unreadableHint };
}

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
