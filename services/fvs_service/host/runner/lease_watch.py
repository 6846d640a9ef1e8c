"""Ends a runner whose worker, frozen or cut off from the database, does not extend the lease in time."""

import os
import select
import sys
import time

from fvs_engine.child_process import EXIT_ORPHANED

_LOOK_EVERY_S = 0.5


class LeaseWatch:
    """Ends the process when its worker has not extended the lease for as long as a lease lasts.

    The worker writes a byte to standard input whenever it has extended the lease.
    """

    def __init__(self, lease_s: float) -> None:
        self._lease_s = lease_s
        self._until = time.monotonic() + lease_s

    def listen(self) -> None:
        """Read the worker's bytes; the end of standard input is the end of the worker."""
        while os.read(0, 4096):
            self._until = time.monotonic() + self._lease_s
        os._exit(EXIT_ORPHANED)

    def guard(self) -> None:
        """End the process when the lease expires.

        Unread bytes count: imports block all other threads, on a slow machine for longer than a lease.
        """
        while time.monotonic() < self._until or _unread():
            time.sleep(_LOOK_EVERY_S)
        print("The scene's lease was not extended.", file=sys.stderr, flush=True)  # noqa: T201 - the log
        os._exit(EXIT_ORPHANED)


def _unread() -> bool:
    return bool(select.select([0], [], [], 0)[0])
