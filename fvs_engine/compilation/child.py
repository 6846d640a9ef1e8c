"""The child process of ``compilation.ahead``: runs one warm-up, one such process at a time.

Its order on standard input names the warm-up's module and its stamp. It prints "done total" after each step.
When it is killed, what it has compiled stays; when its parent dies, it finishes its work.
"""

import fcntl
import json
import sys
from contextlib import suppress
from pathlib import Path

from fvs_engine.compilation.ahead import is_valid, run_warm_up


def main() -> None:
    """Run the warm-up, unless another process has just done so."""
    order = json.loads(sys.stdin.readline())
    stamp = Path(order["stamp"])
    with stamp.with_suffix(".lock").open("w") as lock:
        with suppress(OSError):  # where files cannot be locked, two processes compile the same
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not is_valid(stamp):
            run_warm_up(order["warm_up"], stamp, _report)


def _report(done: int, total: int) -> None:
    sys.stdout.write(f"{done} {total}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
