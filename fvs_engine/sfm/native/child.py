"""The SfM child process: takes one job from standard input, answers on standard output.

The order is a line of JSON: ``job`` and ``arguments`` (see ``jobs``), and ``parent``, the id of the process
that the child ends with. Answers are lines of JSON: any number of ``event``, then a ``result`` or ``error``.
"""

import json
import os
import sys
import traceback
from typing import Any

from fvs_engine.child_process import EXIT_ORPHANED, end_with_parent


def _answer(message: dict[str, Any]) -> None:
    sys.__stdout__.write(json.dumps(message) + "\n")  # type: ignore[union-attr]
    sys.__stdout__.flush()  # type: ignore[union-attr]


def main() -> None:
    """Run the job that the first line of standard input names."""
    line = sys.stdin.buffer.readline()
    if not line:
        sys.exit(EXIT_ORPHANED)
    order = json.loads(line)
    end_with_parent(order["parent"])
    sys.stdout = sys.stderr  # output of libraries goes to the log
    try:
        from fvs_engine.sfm.native.jobs import find_job

        result = find_job(order["job"])(lambda event: _answer({"event": event}), **order["arguments"])
    except Exception as error:
        traceback.print_exc()
        _answer({"error": str(error) or type(error).__name__})
    else:
        _answer({"result": result})
    sys.stderr.flush()
    os._exit(0)  # skips destructors of C++ libraries, which may hang or crash


if __name__ == "__main__":
    main()
