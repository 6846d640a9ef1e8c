"""A worker's process: it takes jobs until it is stopped, and sends heartbeats."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator

import structlog
from sqlalchemy.exc import SQLAlchemyError

from fvs_service.application import Storage
from fvs_service.errors import ServiceError
from fvs_service.host.worker.dispatcher import Dispatcher
from fvs_service.host.worker.heartbeat import Heartbeats
from fvs_service.host.worker.hosts import SceneHosts
from fvs_service.host.worker.runners import RunnerRequests
from fvs_service.jobs.fleet import HEARTBEAT_S
from fvs_service.storage.notifications import Topic

_POLL_S = 10.0
"""Interval at which jobs are looked for whose notification was lost, or that lacked room."""

_log = structlog.get_logger()


def run_worker(storage: Storage, hosts: SceneHosts, worker_id: str, beat: Callable[[], None]) -> bool:
    """Run jobs until SIGTERM or SIGINT; to be called in the main thread of a process of its own.

    ``beat`` is called when it is ready and before every heartbeat, with or without the database. Returns
    False when it ends because another process is the worker now.
    """
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    heartbeats = Heartbeats(storage.database, worker_id)
    heartbeats.beat(**hosts.status.model_dump())
    dispatcher = Dispatcher(
        worker_id,
        storage.queue,
        RunnerRequests(storage.database),
        hosts.run,
        hosts.start_runner,
        slots=hosts.turns_at_once,
        starts_at_once=hosts.starts_at_once,
        poll_s=_POLL_S,
        has_room=lambda: hosts.status.takes_jobs,
    )
    subscription = storage.database.subscribe({Topic.JOBS: dispatcher.wake, Topic.RUNNERS: dispatcher.wake})
    dispatcher.start()
    beat()
    _log.info("worker ready", worker=worker_id)
    try:
        while not stop.wait(HEARTBEAT_S):
            with _without_database():
                if not heartbeats.beat(**hosts.status.model_dump()):
                    return False
            beat()
    finally:
        subscription.close()
        dispatcher.stop()
        hosts.stop()
        with _without_database():
            heartbeats.end()
    return True


@contextlib.contextmanager
def _without_database() -> Iterator[None]:
    """Log that the database is away, and go on."""
    try:
        yield
    except (SQLAlchemyError, ServiceError) as error:
        _log.warning("database unavailable", reason=type(error).__name__)
