"""The pulse of a gateway or worker: a process that hangs does not die, and nobody would restart it.

The gateway's event loop writes an empty line to its standard output every ``PULSE_S``, a worker's main thread
before every heartbeat. Their supervisor kills a process when none has come for long.
"""

import contextlib
import os
import time

PULSE_S = 5.0
_MOST_PER_LOOK_S = 10.0
"""How much silence one look adds at most: the supervisor itself may have been frozen in between."""


def beat() -> None:
    """In a gateway on its event loop, in a worker on its main thread: show that it runs. Never waits."""
    with contextlib.suppress(OSError):  # the pipe is full when the supervisor is frozen
        os.write(1, b"\n")


class Pulse:
    """In the supervisor: the beats of one process, read from ``pipe``, its standard output.

    ``begun``: its first line has been read already.
    """

    def __init__(self, pipe: int, *, begun: bool = False) -> None:
        os.set_blocking(pipe, False)
        self._pipe = pipe
        self._looked = time.monotonic()
        self._silent_s = 0.0
        self._begun = begun

    def silent_s(self) -> float:
        """How long there has been no beat, to be asked every few seconds; 0 before its first line."""
        now = time.monotonic()
        if self._begun:
            self._silent_s += min(now - self._looked, _MOST_PER_LOOK_S)
        self._looked = now
        with contextlib.suppress(BlockingIOError):
            if os.read(self._pipe, 4096):
                self._begun, self._silent_s = True, 0.0
        return self._silent_s
