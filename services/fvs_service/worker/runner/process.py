"""The runner's process: it is told what to be on standard input, says where it answers, and serves.

It ends when its worker does: by the kernel's signal where there is one, when standard input ends, when
nobody extends its lease for too long (a frozen worker), and when another process has become its parent.
"""

import contextlib
import ctypes
import json
import os
import secrets
import select
import signal
import sys
import threading
import time
from typing import TextIO

from fvs_engine.errors import OutputExistsError
from fvs_engine.files.lock import locked_folder
from fvs_service.settings import Settings
from fvs_service.worker.protocol import Message

EXIT_YIELDED = 0
_EXIT_ORPHANED = 3
_EXIT_LOCKED = 4
_LOCK_PATIENCE_S = 10.0
_WATCH_S = 0.5
_NICENESS = 5
"""What computes gives way to what answers."""
_PR_SET_PDEATHSIG = 1


class RunnerOrder(Message):
    """What a runner is told first."""

    scene_id: str
    parent: int
    settings: Settings


def main() -> None:
    """Be the runner that the first line of standard input asks for."""
    order = RunnerOrder.model_validate_json(sys.stdin.buffer.readline())
    die_with_parent(order.parent)
    os.nice(_NICENESS)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the supervisor
    answers = _own_standard_output()
    watch = LeaseWatch(order.parent, order.settings.lease_s)
    threading.Thread(target=watch.listen, daemon=True).start()
    threading.Thread(target=watch.guard, daemon=True).start()
    folder = order.settings.scenes.absolute() / order.scene_id
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(locked_folder(folder, _LOCK_PATIENCE_S))
        except OutputExistsError:
            print("Another runner holds the scene's folder.", file=sys.stderr, flush=True)  # noqa: T201 - the log
            os._exit(_EXIT_LOCKED)
        from fvs_service.worker.runner.server import RunnerServer

        secret = secrets.token_urlsafe(24)
        server = RunnerServer(order.scene_id, folder, order.settings, secret)
        host, port = server.address
        answers.write(json.dumps({"endpoint": f"{host}:{port}/{secret}"}) + "\n")
        answers.flush()
        server.serve()
    os._exit(EXIT_YIELDED)  # threads that still answer must not hold it


def die_with_parent(parent: int) -> None:
    """Ask the kernel to kill this process when the thread that made it ends, where it can; check the rest."""
    with contextlib.suppress(OSError, AttributeError):  # on other systems there is only the watch
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(_EXIT_ORPHANED)


class LeaseWatch:
    """Ends the process when its worker is gone, or has not extended the lease for as long as it lasts."""

    def __init__(self, parent: int, lease_s: float) -> None:
        self._parent = parent
        self._lease_s = lease_s
        self._until = time.monotonic() + lease_s

    def listen(self) -> None:
        """Take the worker's word, a byte whenever it extended the lease; its end is the worker's."""
        while os.read(0, 4096):
            self._until = time.monotonic() + self._lease_s
        os._exit(_EXIT_ORPHANED)

    def guard(self) -> None:
        """Look whether the worker still is what it was.

        Words that were not read yet count: imports keep all other threads waiting, on a slow machine for
        longer than a lease.
        """
        while os.getppid() == self._parent and (time.monotonic() < self._until or _unread()):
            time.sleep(_WATCH_S)
        print("The worker is gone, or holds the scene no longer.", file=sys.stderr, flush=True)  # noqa: T201 - the log
        os._exit(_EXIT_ORPHANED)


def _unread() -> bool:
    return bool(select.select([0], [], [], 0)[0])


def _own_standard_output() -> TextIO:
    """Keep standard output for answers to the worker: what libraries print goes to the log."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    return answers


if __name__ == "__main__":
    main()
