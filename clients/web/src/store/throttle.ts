/** Run `work` soon, and again after its end if it was asked for meanwhile; never twice at once. */
export function throttled(work: () => Promise<void>, pauseMs: number): () => void {
  let wanted = false;
  let running = false;
  const run = async () => {
    running = true;
    while (wanted) {
      wanted = false;
      await work().catch(() => undefined); // `work` reports its own failures
      await new Promise((resolve) => setTimeout(resolve, pauseMs));
    }
    running = false;
  };
  return () => {
    wanted = true;
    if (!running) void run();
  };
}
