"""The SfM child process: runs jobs one after another, each in a fork of itself.

A fork saves the half second that importing pycolmap takes, and leaves nothing behind: no memory, no library
state. Orders are lines of JSON on standard input: ``job`` and ``request`` (see ``sfm.jobs``), ``folder``, the
current one, and ``log``, a file for what libraries print. Answers are lines of JSON on standard output: any
number of ``event``, a ``result`` or ``error``, and ``ended``, the fork's exit status, or minus the signal
that killed it; or ``no_process``, the reason why there is no fork. The argument is the id of the parent
process, with which this one ends.
"""

import json
import os
import signal
import sys
import traceback
from collections.abc import Callable
from typing import Any

from fvs_engine.child_process import kill_with_parent
from fvs_engine.records import Record
from fvs_engine.sfm.jobs import REQUESTS


def main() -> None:
    """Run jobs until standard input ends."""
    kill_with_parent(int(sys.argv[1]))
    answers = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # output of libraries goes to the log
    for line in sys.stdin.buffer:
        from fvs_engine.sfm.native.jobs import find_job  # pycolmap: before the fork, and once

        order, server = json.loads(line), os.getpid()
        job = find_job(order["job"])
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # pycolmap's handler writes a stack trace to the log
        try:
            pid = os.fork()
        except OSError as error:
            _answer(answers, {"no_process": error.strerror})
            continue
        if pid == 0:
            kill_with_parent(server)
            _run(job, order, answers)
        _, status = os.waitpid(pid, 0)
        # The fork may have died in the middle of a line.
        _answer(answers, {"ended": os.waitstatus_to_exitcode(status)}, start="\n")


def _run(job: Callable[..., Any], order: dict[str, Any], answers: int) -> None:
    """Run one job in the fork, and end it."""
    log = os.open(order["log"], os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    for stream in (1, 2):
        os.dup2(log, stream)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    try:
        os.chdir(order["folder"])
        request = REQUESTS[order["job"]].model_validate(order["request"])
        result = job(request, lambda event: _answer(answers, {"event": event}))
        if isinstance(result, Record):
            result = result.model_dump(mode="json")
    except Exception as error:
        traceback.print_exc()
        _answer(answers, {"error": str(error) or type(error).__name__})
    else:
        _answer(answers, {"result": result})
    sys.stderr.flush()
    os._exit(0)  # skips destructors of C++ libraries, which may hang or crash


def _answer(answers: int, message: dict[str, Any], start: str = "") -> None:
    line = f"{start}{json.dumps(message)}\n".encode()
    while line:
        line = line[os.write(answers, line) :]


if __name__ == "__main__":
    main()
