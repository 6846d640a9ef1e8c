import { expect, it, vi } from "vitest";
import { throttled } from "./throttle";

it("runs once at a time, and once more for all that was asked for meanwhile", async () => {
  vi.useFakeTimers();
  let ends: () => void = () => undefined;
  const work = vi.fn(() => new Promise<void>((resolve) => (ends = resolve)));
  const run = throttled(work, 10);
  run();
  run();
  run();
  expect(work).toHaveBeenCalledTimes(1);
  ends();
  await vi.advanceTimersByTimeAsync(20);
  expect(work).toHaveBeenCalledTimes(2);
  ends();
  await vi.advanceTimersByTimeAsync(20);
  expect(work).toHaveBeenCalledTimes(2);
  vi.useRealTimers();
});
