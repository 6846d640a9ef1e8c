import { expect, it } from "vitest";
import type { Schemas } from "../api/service";
import { ended } from "./job-notices";

it("finds the jobs that ended since", () => {
  const job = (id: string, state: Schemas["JobState"]) => ({ id, state }) as Schemas["Job"];
  const before = new Map([
    ["a", "running"],
    ["b", "succeeded"],
    ["c", "queued"],
  ] as [string, Schemas["JobState"]][]);
  const jobs = [job("a", "failed"), job("b", "succeeded"), job("c", "running"), job("d", "succeeded")];
  expect(ended(before, jobs).map((one) => one.id)).toEqual(["a"]);
});
