"""The supervisor's child processes: ``python -m fvs_service.serving.process gateway|worker``.

The first line of standard input is a ``ProcessOrder``. A gateway writes its ``Addresses`` to standard output
once it answers. Then both write their pulse to it (``pulse``).
"""

import ctypes
import os
import sys
from typing import TYPE_CHECKING

from fvs_engine.child_process import end_with_parent
from fvs_service.application import Storage, open_storage
from fvs_service.gateway.addresses import Addresses
from fvs_service.host.worker.runners import LeasedRunners
from fvs_service.logs import configure_logging, log_uncaught
from fvs_service.serving.process_order import EXIT_REPLACED, GATEWAY, ProcessOrder
from fvs_service.serving.pulse import PULSE_S, beat
from fvs_service.tracing import Tracing

if TYPE_CHECKING:
    from fvs_service.host.worker.hosts import SceneHosts

_M_ARENA_MAX = -8
_ARENAS = 2


def main() -> None:
    """Run a gateway or a worker until SIGINT or SIGTERM."""
    limit_arenas()  # before there are threads
    (role,) = sys.argv[1:]
    order = ProcessOrder.model_validate_json(sys.stdin.buffer.readline())
    end_with_parent(order.parent)
    configure_logging(machine=order.log_json)
    log_uncaught()
    if role == GATEWAY:
        _run_gateway(order)
    else:
        _run_worker(order)


def _run_gateway(order: ProcessOrder) -> None:
    from fvs_service.serving.gateway import run_gateway  # a worker has no use for FastAPI

    os.set_blocking(sys.stdout.fileno(), False)  # for the pulse
    run_gateway(order.settings, LeasedRunners, announce=_print, beat=beat, beat_every_s=PULSE_S)
    os._exit(0)  # without waiting for threads whose requests have been given up


def _print(addresses: Addresses) -> None:
    print(addresses.model_dump_json(), flush=True)  # noqa: T201


def _run_worker(order: ProcessOrder) -> None:
    from fvs_service.host.worker.process import run_worker

    os.set_blocking(sys.stdout.fileno(), False)  # for the pulse
    tracing = Tracing.of_environment("fvs-worker")
    with open_storage(order.settings, tracing) as storage:
        stopped = run_worker(storage, _hosts_of(storage, order.name), order.name, beat)
    tracing.close()
    # Without waiting for attempts that still run: the next process resumes them.
    os._exit(0 if stopped else EXIT_REPLACED)


def _hosts_of(storage: Storage, worker_id: str) -> "SceneHosts":
    if storage.settings.cluster is None:
        from fvs_service.host.worker.hosts import LocalHosts

        return LocalHosts(storage, worker_id)
    from fvs_service.host.cluster.hosts import ClusterHosts  # imports Ray

    return ClusterHosts(storage, worker_id)


def limit_arenas() -> None:
    """Let all threads of this process share a few arenas; no effect where the C library is not glibc.

    glibc gives up to eight threads per core an arena each, and freed memory stays in the arena that it came
    from. A gateway answers requests in the threads of a pool: after 20 minutes of load it held 13 MB of freed
    memory, three times as much as at its start, and growing. With few arenas the threads reuse each other's
    memory; they seldom wait for one, since Python's own lock lets one of them run at a time.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_ARENA_MAX, _ARENAS)


if __name__ == "__main__":
    main()
