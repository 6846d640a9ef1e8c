"""The runner's process: reads its order from standard input, writes its endpoint to standard output, serves.

It ends with its worker: when the worker's process ends, and when the worker, frozen or cut off from the
database, does not extend the scene's lease in time.
"""

import contextlib
import os
import secrets
import signal
import sys
import threading
from typing import TextIO

from fvs_engine.child_process import end_with_parent
from fvs_engine.errors import OutputExistsError
from fvs_engine.files.lock import locked_folder
from fvs_service.host.protocol.messages import RunnerOrder, RunnerStarted
from fvs_service.host.runner.lease_watch import LeaseWatch

_EXIT_YIELDED = 0
_EXIT_LOCKED = 4
_LOCK_PATIENCE_S = 10.0
_NICENESS = 5
"""Training gets less processor time than the gateway and the workers."""


def main() -> None:
    """Run the runner of the scene that the order on standard input names."""
    order = RunnerOrder.model_validate_json(sys.stdin.buffer.readline())
    end_with_parent(order.parent)
    os.nice(_NICENESS)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the supervisor handles Ctrl-C
    endpoint = _own_standard_output()
    watch = LeaseWatch(order.settings.lease_s)
    threading.Thread(target=watch.listen, daemon=True).start()
    threading.Thread(target=watch.guard, daemon=True).start()
    folder = order.settings.scenes.absolute() / order.scene_id
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(locked_folder(folder, _LOCK_PATIENCE_S))
        except OutputExistsError:
            print("Another runner uses the scene's folder.", file=sys.stderr, flush=True)  # noqa: T201 - the log
            os._exit(_EXIT_LOCKED)
        from fvs_service.host.runner.server import RunnerServer

        secret = secrets.token_urlsafe(24)
        server = RunnerServer(order.scene_id, folder, order.settings, order.address, secret)
        _, port = server.address
        started = RunnerStarted(endpoint=f"{order.address}:{port}/{secret}", backend=server.backend)
        endpoint.write(started.model_dump_json() + "\n")
        endpoint.flush()
        server.serve()
    os._exit(_EXIT_YIELDED)  # without waiting for threads that still send responses


def _own_standard_output() -> TextIO:
    """Keep standard output for the endpoint: what libraries print goes to the log."""
    own = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    return own


if __name__ == "__main__":
    main()
