"""The child process of ``native``: takes one job from standard input, answers on standard output."""

import json
import os
import sys
import threading
import traceback
from typing import Any


def _die_with_parent() -> None:
    """End this process when standard input ends: nobody waits for the answer any more."""
    try:
        while os.read(0, 4096):
            pass
    finally:
        os._exit(1)


def _answer(message: dict[str, Any]) -> None:
    sys.__stdout__.write(json.dumps(message) + "\n")  # type: ignore[union-attr]
    sys.__stdout__.flush()  # type: ignore[union-attr]


def main() -> None:
    """Run the job that the first line of standard input names."""
    order = json.loads(sys.stdin.buffer.readline())
    threading.Thread(target=_die_with_parent, daemon=True).start()
    sys.stdout = sys.stderr  # what libraries print belongs in the log
    try:
        from fvs_engine.sfm.native.jobs import find_job

        result = find_job(order["job"])(lambda event: _answer({"event": event}), **order["arguments"])
    except Exception as error:
        traceback.print_exc()
        _answer({"error": str(error) or type(error).__name__})
    else:
        _answer({"result": result})
    sys.stderr.flush()
    os._exit(0)  # the watching thread must not hold the process back


if __name__ == "__main__":
    main()
