"""``fvs serve``: starts a gateway, workers or both, restarts those that die, and stops them together."""

import contextlib
import os
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

import structlog

from fvs_engine import child_process
from fvs_engine.errors import InvalidInputError, OutputExistsError
from fvs_engine.files.lock import locked_folder
from fvs_engine.files.storage import storage_errors
from fvs_service.application import Storage, open_storage
from fvs_service.errors import (
    ConflictError,
    StorageRefusedError,
    StorageUnavailableError,
    UnavailableError,
)
from fvs_service.events.repository import skip_lost_numbers
from fvs_service.gateway.addresses import Addresses
from fvs_service.gateway.protection import require_protection
from fvs_service.host.worker.heartbeat import require_no_workers
from fvs_service.serving.process_order import CLUSTER, EXIT_REPLACED, GATEWAY, WORKER, ProcessOrder
from fvs_service.serving.process_tree import adopt_orphans, end_descendants, reap_adopted
from fvs_service.serving.pulse import Pulse
from fvs_service.serving.stop_signals import StopSignals
from fvs_service.settings import Settings
from fvs_service.storage.owner import claim_store

_LOOK_S = 5.0
"""Interval at which the supervisor looks for dead children without a SIGCHLD, too."""
_START_S = 60.0
_STOP_S = 3.5
"""How long children may take to end by themselves, a gateway beyond ``drain_s``; they are killed after it."""
_KILLED_S = 1.0
_QUICK_S = 5.0
"""After a child that died sooner than this, the pause before its next start doubles."""
_FIRST_PAUSE_S, _LAST_PAUSE_S = 0.2, 10.0
_SILENT_S = {GATEWAY: 60.0, WORKER: 180.0}
"""Silence after which a process is killed and restarted; a worker may be waiting for its database."""

_log = structlog.get_logger()


@dataclass
class _Child:
    """A process that is restarted when it dies; ``name`` stays the same."""

    name: str
    role: str
    process: "subprocess.Popen[str] | None" = None
    pulse: Pulse | None = None
    started: float = 0.0
    pause_s: float = _FIRST_PAUSE_S
    due: float = field(default=0.0)


class Role(StrEnum):
    """Processes that a supervisor starts on its machine."""

    ALL = "all"
    GATEWAY = "gateway"
    WORKER = "worker"


class Supervisor:
    """Runs the service, or its part on this machine, until a signal arrives."""

    def __init__(
        self, settings: Settings, signals: StopSignals, *, log_json: bool, role: Role = Role.ALL
    ) -> None:
        self._settings = settings
        self._signals = signals
        self._log_json = log_json
        self._role = role
        self._gateway = _Child("gateway", GATEWAY)
        names = [f"worker-{number}" for number in range(settings.worker.count)]
        self._workers = [_Child(name, WORKER) for name in ([CLUSTER] if settings.cluster else names)]
        if role is Role.GATEWAY:
            self._workers = []

    def run(self, announce: Callable[[str], object]) -> None:
        """Start all processes, call ``announce`` with the gateway's URLs, and supervise until a signal.

        Raises ``ForbiddenError`` when requests need an API key and there is no valid one,
        ``ConflictError`` when another service runs on the root, or has workers on the database, now or later,
        ``StorageError`` when the root cannot be written, ``UnavailableError`` when the gateway does not
        start, the database cannot be reached, or the blob store refuses, or belongs to another database.
        """
        if self._role is not Role.GATEWAY:
            _require_ray(self._settings, self._role)
        if self._role is not Role.WORKER:
            _log.info(require_protection(self._settings))
        with _only_service_in(self._settings.root):
            adopt_orphans()
            with open_storage(self._settings) as storage:  # the processes meet a database that is migrated
                _require_blobs(storage)
                if self._workers:
                    self._take_over(storage)
                with storage.database.writing() as session:
                    skip_lost_numbers(session)
            try:
                if self._role is not Role.WORKER:
                    addresses = self._start_gateway()
                    if addresses is None:
                        return
                    announce(addresses.url)
                    announce(addresses.rpc_url or "without gRPC")
                for worker in self._workers:
                    self._start(worker)
                while not self._signals.wait(self._until_next_start_s()):
                    for child in self._children():
                        self._restart_if_dead(child)
                        self._kill_if_silent(child)
                    reap_adopted({process.pid for process in self._running().values()})
            finally:
                self._stop_all()

    def _take_over(self, storage: Storage) -> None:
        """Take the jobs from workers of earlier starts that are not started now."""
        if not self._settings.on_one_machine:  # else the lock on the root keeps another service away
            require_no_workers(storage.database)
        put_back = storage.queue.keep_workers([worker.name for worker in self._workers])
        if put_back:
            _log.info("jobs of former workers wait", jobs=put_back)

    def _children(self) -> tuple[_Child, ...]:
        gateways = () if self._role is Role.WORKER else (self._gateway,)
        return (*gateways, *self._workers)

    def _start_gateway(self) -> Addresses | None:
        self._start(self._gateway)
        assert self._gateway.process is not None
        line = child_process.first_line(self._gateway.process, _START_S, lambda: self._signals.stopping)
        if not line and self._signals.stopping:
            return None
        if not line:
            host, rpc_port = self._settings.host, self._settings.rpc_port
            raise UnavailableError(
                f"The gateway cannot listen on {host}:{self._settings.port}"
                + (f", or for gRPC on {host}:{rpc_port}." if rpc_port else "."),
                hint="Another program may use the port: choose another with --port (for gRPC --grpc-port), "
                "or 0 for a free one.",
            )
        assert self._gateway.process.stdout is not None
        self._gateway.pulse = Pulse(self._gateway.process.stdout.fileno(), begun=True)
        addresses = Addresses.model_validate_json(line)
        # A restarted gateway must listen where clients found the first one.
        ports = {"port": urlsplit(addresses.url).port, "grpc_port": addresses.rpc_port}
        self._settings = self._settings.model_copy(update=ports)
        return addresses

    def _start(self, child: _Child) -> None:
        order = ProcessOrder(
            name=child.name, parent=os.getpid(), settings=self._settings, log_json=self._log_json
        )
        child.started = time.monotonic()
        child.process = child_process.spawn(
            "fvs_service.serving.process",
            order.model_dump_json(),
            arguments=[child.role],
            stdout=subprocess.PIPE,
        )

    def _until_next_start_s(self) -> float:
        """The time until a child that died is started again."""
        waiting = (child for child in self._children() if child.process is None)
        return max(0.0, min((child.due - time.monotonic() for child in waiting), default=_LOOK_S))

    def _restart_if_dead(self, child: _Child) -> None:
        if child.process is None:
            if time.monotonic() >= child.due:
                self._start(child)
            return
        status = child.process.poll()
        if status is None:
            return
        if status == EXIT_REPLACED:
            raise ConflictError(
                f"Another fvs serve runs the worker {child.name} on this database now.",
                hint="One of them is enough: stop the other one before you start this one again.",
            )
        lived_s = time.monotonic() - child.started
        child.pause_s = min(2 * child.pause_s, _LAST_PAUSE_S) if lived_s < _QUICK_S else _FIRST_PAUSE_S
        _log.warning("child died", name=child.name, status=status, again_in_s=child.pause_s)
        child_process.close_pipes(child.process)
        child.process, child.pulse, child.due = None, None, time.monotonic() + child.pause_s

    def _kill_if_silent(self, child: _Child) -> None:
        if child.process is None:
            return
        if child.pulse is None:  # it has just been started
            assert child.process.stdout is not None
            child.pulse = Pulse(child.process.stdout.fileno())
        silent_s = child.pulse.silent_s()
        if silent_s > _SILENT_S[child.role]:
            _log.warning("child killed", name=child.name, silent_s=round(silent_s))
            child.process.kill()

    def _running(self) -> "dict[str, subprocess.Popen[str]]":
        """The processes that have been started, by name."""
        children = self._children()
        return {child.name: child.process for child in children if child.process is not None}

    def _stop_all(self) -> None:
        """Stop all processes, and kill those that take too long.

        The gateway first: its requests in progress need the workers. What they started ends with them, and is
        killed where it does not.
        """
        began = time.monotonic()
        running = self._running()
        gateway = running.pop(self._gateway.name, None)
        if gateway is not None:
            _stop({self._gateway.name: gateway}, self._settings.drain_s + _STOP_S)
        _stop(running, _STOP_S)
        end_descendants(_KILLED_S)
        _log.info("stopped", seconds=round(time.monotonic() - began, 1))


def _stop(running: "Mapping[str, subprocess.Popen[str]]", within_s: float) -> None:
    """Let processes end, and kill those that take longer."""
    for process in running.values():
        process.terminate()
    until = time.monotonic() + within_s
    for name, process in running.items():
        try:
            process.wait(max(0.1, until - time.monotonic()))
        except subprocess.TimeoutExpired:
            _log.warning("child killed", name=name, after_s=within_s)
            process.kill()
            process.wait()
        child_process.close_pipes(process)


def _require_ray(settings: Settings, role: Role) -> None:
    """Raise ``InvalidInputError`` where the role needs a cluster, and where the cluster needs Ray."""
    if settings.cluster is None and role is Role.WORKER:
        raise InvalidInputError(
            "--role worker is for a Ray cluster, and FVS_CLUSTER is not set.",
            hint="Set FVS_CLUSTER, or run `fvs serve`: on one machine it has a gateway and workers.",
        )
    if settings.cluster is not None and find_spec("ray") is None:
        raise InvalidInputError("FVS_CLUSTER needs Ray.", hint="Install the service with the extra `ray`.")


def _require_blobs(storage: Storage) -> None:
    """Raise ``StorageRefusedError`` when the store will not serve this database; it may be away."""
    try:
        storage.blobs.check()
        claim_store(storage.database, storage.blobs)
    except StorageRefusedError:
        raise
    except StorageUnavailableError as error:
        _log.warning(error.message, hint=error.hint)


@contextlib.contextmanager
def _only_service_in(root: Path) -> Iterator[None]:
    """Lock ``root`` against a second service, whose workers would have the same ids and share leases."""
    with storage_errors(root):
        root.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(locked_folder(root))
        except OutputExistsError as error:
            raise ConflictError(
                f"Another fvs serve runs on {root}.", hint="Use that one, or choose another --root."
            ) from error
        yield
