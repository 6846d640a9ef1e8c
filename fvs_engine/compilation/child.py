"""The child process of ``compilation``: runs one rehearsal, one such process at a time."""

import fcntl
import sys
from contextlib import suppress
from pathlib import Path

from fvs_engine.compilation.ahead import is_valid, rehearse


def main() -> None:
    """Arguments: the rehearsal's module and its stamp. Writes "done total" after each step.

    Killed half-way it leaves what it has compiled; a child whose parent has died finishes its work.
    """
    rehearsal, stamp = sys.argv[1], Path(sys.argv[2])
    with stamp.with_suffix(".lock").open("w") as lock:
        with suppress(OSError):  # where files cannot be locked, two processes compile the same
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not is_valid(stamp):  # else another process has just done it
            rehearse(rehearsal, stamp, _tell)


def _tell(done: int, total: int) -> None:
    sys.stdout.write(f"{done} {total}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
