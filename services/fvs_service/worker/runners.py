"""The gateway's way to the runners: by the scene's lease, straight to the process with the model."""

import base64
import math
import threading
import time
from collections import defaultdict
from typing import Any

from pydantic import BaseModel

from fvs_service.application import Storage
from fvs_service.errors import UnavailableError
from fvs_service.rankings.port import DrawView, RankedView, RankedViews, RankViews
from fvs_service.worker.protocol import (
    DrawQuestion,
    Line,
    RankQuestion,
    RunnerError,
    RunnerGoneError,
    answer_to,
    connect,
    error_of,
)
from fvs_service.worker.queue import Queue

METHODS = (
    *("median-frequency", "spectral-median", "fisher", "d-optimal", "coverage"),
    *("farthest", "nearest", "uniform", "random"),
)
"""The engine's selectors by name; written out, because a gateway has no use for torch, which they import."""

_CONNECT_S = 2.0
_ANSWER_S = 120.0
_WARM_S = 45.0
"""How long a question waits for a cold scene: as long as a runner takes to start, with room to spare."""
_WARM_AGAIN_S = 2.0
_POLL_S = 0.1
_KEPT_LINES = 8


class LeasedRunners:
    """See ``SceneRunners``."""

    methods = METHODS

    def __init__(self, storage: Storage) -> None:
        self._leases = storage.leases
        self._queue = Queue(storage.settings.queue)
        self._lines = _Lines()

    def rank(self, request: RankViews) -> RankedViews:
        """See ``SceneRunners``."""
        answer = self._ask(request.scene_id, RankQuestion.of(request))
        views = tuple(RankedView(**view) for view in answer.pop("views"))
        return RankedViews(views=views, **answer)

    def draw(self, request: DrawView) -> bytes:
        """See ``SceneRunners``."""
        return base64.b64decode(self._ask(request.scene_id, DrawQuestion.of(request)))

    def _ask(self, scene_id: str, question: BaseModel) -> Any:
        """Ask the scene's runner, again when it died or moved; have it warmed when there is none."""
        until = time.monotonic() + _WARM_S
        warmed = -math.inf
        while True:
            holder = self._leases.holder(scene_id)
            if holder is not None and holder.endpoint is not None:
                try:
                    return self._lines.ask(holder.endpoint, question)
                except RunnerError as error:
                    raise error_of(error.note) from error
                except RunnerGoneError:
                    pass  # its lease outlives it for a while
            if time.monotonic() - warmed > _WARM_AGAIN_S:
                self._queue.warm(scene_id)
                warmed = time.monotonic()
            if time.monotonic() > until:
                raise UnavailableError(
                    "No worker has the scene's model at hand.",
                    hint="Ask again soon: it is being loaded, or waits for memory.",
                    retry_after_s=10,
                )
            time.sleep(_POLL_S)


class _Lines:
    """Connections that are kept for the next question; a line serves one question at a time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._free: defaultdict[str, list[Line]] = defaultdict(list)

    def ask(self, endpoint: str, question: BaseModel) -> Any:
        """Ask over a kept line, or over a new one if there is none or it was cut meanwhile."""
        kept = self._take(endpoint)
        if kept is not None:
            try:
                return self._use(endpoint, kept, question)
            except RunnerGoneError:
                self._forget(endpoint)
        return self._use(endpoint, connect(endpoint, _CONNECT_S), question)

    def _use(self, endpoint: str, line: Line, question: BaseModel) -> Any:
        try:
            line.wait_at_most(_ANSWER_S)
            answer = answer_to(line, question)
        except RunnerError:
            self._keep(endpoint, line)
            raise
        except BaseException:
            line.close()
            raise
        self._keep(endpoint, line)
        return answer

    def _take(self, endpoint: str) -> Line | None:
        with self._lock:
            free = self._free.get(endpoint)
            return free.pop() if free else None

    def _keep(self, endpoint: str, line: Line) -> None:
        with self._lock:
            if len(self._free[endpoint]) < _KEPT_LINES:
                self._free[endpoint].append(line)
                return
        line.close()

    def _forget(self, endpoint: str) -> None:
        with self._lock:
            dead = self._free.pop(endpoint, [])
        for line in dead:
            line.close()
