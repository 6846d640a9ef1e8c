"""The gateway's client of the runners: finds a scene's runner by its lease and connects to it directly."""

import base64
import math
import threading
import time
from collections import defaultdict
from typing import Any, get_args

from fvs_engine.choices import Method
from fvs_engine.records import Record
from fvs_service.application import Storage
from fvs_service.errors import UnavailableError
from fvs_service.rankings.port import RankedViews, RankViews, RenderView
from fvs_service.worker.protocol.connection import (
    Connection,
    RunnerError,
    RunnerGoneError,
    connect,
    result_of,
)
from fvs_service.worker.protocol.messages import error_of
from fvs_service.worker.queue import Queue

METHODS: tuple[str, ...] = get_args(Method)
"""The names of the engine's selectors; importing the selectors themselves would import torch."""

_CONNECT_S = 2.0
_RESPONSE_S = 120.0
_START_S = 45.0
"""How long a request waits for a scene without a runner: somewhat longer than a runner takes to start."""
_START_AGAIN_S = 2.0
_POLL_S = 0.1
_KEPT_CONNECTIONS = 8


class LeasedRunners:
    """The ``SceneRunners`` of a gateway, found by the leases of their scenes."""

    methods = METHODS

    def __init__(self, storage: Storage) -> None:
        self._leases = storage.leases
        self._queue = Queue(storage.settings.queue)
        self._connections = _ConnectionPool()

    def rank(self, request: RankViews) -> RankedViews:
        """See ``SceneRunners``."""
        return RankedViews.model_validate(self._call(request.scene_id, request))

    def render(self, request: RenderView) -> bytes:
        """See ``SceneRunners``."""
        return base64.b64decode(self._call(request.scene_id, request))

    def _call(self, scene_id: str, request: Record) -> Any:
        """The scene's runner's result; tries again when the runner died or moved, starts one if need be."""
        until = time.monotonic() + _START_S
        started = -math.inf
        while True:
            holder = self._leases.holder(scene_id)
            if holder is not None and holder.endpoint is not None:
                try:
                    return self._connections.call(holder.endpoint, request)
                except RunnerError as error:
                    raise error_of(error.failure) from error
                except RunnerGoneError:
                    pass  # the lease of a dead runner lasts a while longer
            if time.monotonic() - started > _START_AGAIN_S:
                self._queue.start_runner(scene_id)
                started = time.monotonic()
            if time.monotonic() > until:
                raise UnavailableError(
                    "No worker has loaded the scene's model.",
                    hint="Try again soon: it is being loaded, or waits for memory.",
                    retry_after_s=10,
                )
            time.sleep(_POLL_S)


class _ConnectionPool:
    """Connections that are kept for the next request; each serves one request at a time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._free: defaultdict[str, list[Connection]] = defaultdict(list)

    def call(self, endpoint: str, request: Record) -> Any:
        """The result over a kept connection, or over a new one if there is none or it was cut."""
        kept = self._take(endpoint)
        if kept is not None:
            try:
                return self._use(endpoint, kept, request)
            except RunnerGoneError:
                self._forget(endpoint)
        return self._use(endpoint, connect(endpoint, _CONNECT_S), request)

    def _use(self, endpoint: str, connection: Connection, request: Record) -> Any:
        try:
            connection.set_timeout(_RESPONSE_S)
            result = result_of(connection, request)
        except RunnerError:
            self._keep(endpoint, connection)
            raise
        except BaseException:
            connection.close()
            raise
        self._keep(endpoint, connection)
        return result

    def _take(self, endpoint: str) -> Connection | None:
        with self._lock:
            free = self._free.get(endpoint)
            return free.pop() if free else None

    def _keep(self, endpoint: str, connection: Connection) -> None:
        with self._lock:
            if len(self._free[endpoint]) < _KEPT_CONNECTIONS:
                self._free[endpoint].append(connection)
                return
        connection.close()

    def _forget(self, endpoint: str) -> None:
        with self._lock:
            dead = self._free.pop(endpoint, [])
        for connection in dead:
            connection.close()
