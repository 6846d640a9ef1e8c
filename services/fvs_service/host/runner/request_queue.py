"""The queue of a scene's rankings and renders: one at a time, before training; API keys take turns.

Equal requests that arrive while one is queued or computed share one computation, each over its own
connection. When the last requester has hung up or timed out, the computation leaves the queue, or stops
between two views.
"""

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass
from typing import Any

from fvs_engine.monitor import Monitor, Progress
from fvs_schema.stages import Stage
from fvs_service.errors import LimitExceededError, deadline_passed
from fvs_service.host.protocol.messages import QueueStatus

_LONGEST_PAUSE_S = 2.0
"""Training makes a step at least this often, however many requests arrive."""
_POLL_S = 0.1
_PACE_WEIGHT = 0.3
"""Weight of the newest measurement in the moving average."""


class Pace:
    """Seconds per view by kind (a method, or ``render``): a moving average of what was measured."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}

    def add(self, kind: str, views: float, seconds: float) -> None:
        """Add a measurement: ``views`` took ``seconds``."""
        if views <= 0:
            return
        measured = seconds / views
        before = self._seconds.get(kind, measured)
        self._seconds[kind] = before + _PACE_WEIGHT * (measured - before)

    def expected_s(self, kind: str, views: int) -> float:
        """The expected time of ``views``: as the slowest kind while this one is unknown, 0 while all are."""
        seconds = self._seconds.get(kind)
        if seconds is None:
            seconds = max(self._seconds.values(), default=0.0)
        return seconds * views


@dataclass(frozen=True)
class Task:
    """Work to do: ``views`` of one ``kind``, whose pace is measured. Equal keys have equal results."""

    key: str
    kind: str
    views: int
    compute: Callable[[Monitor], Any]


@dataclass(frozen=True, eq=False)
class Requester:
    """The sender of a request: its API key, timeout, and whether its connection has ended.

    ``pass_on`` gets the partial results before the answer, in the requester's thread.
    """

    api_key: str
    timeout_s: float
    gone: Callable[[], bool]
    pass_on: Callable[[Sequence[Any]], object] | None = None


class RequesterGoneError(Exception):
    """The connection of the request has ended, so that the answer cannot be delivered."""


class _Computation:
    """A task in the queue, and the requesters that wait for its answer; ``api_key`` is that of the first."""

    def __init__(self, task: Task, api_key: str) -> None:
        self.task, self.api_key = task, api_key
        self.requesters: set[Requester] = set()
        self.answer: Future[Any] = Future()
        self.results: list[Any] = []
        """The partial results so far."""
        self.monitor = Monitor(self._on_progress, self.results.extend)
        self.started = math.inf
        self.share = 0.0

    def _on_progress(self, progress: Progress) -> None:
        if progress.share is not None and progress.stage is not Stage.COMPILE:
            self.share = progress.share

    def pass_on(self, requester: Requester, known: int) -> int:
        """Pass the results after the first ``known`` on to a requester; returns how many there are."""
        results = self.results[known:]
        if results and requester.pass_on is not None:
            requester.pass_on(results)
        return known + len(results)

    def left_s(self, pace: Pace) -> float:
        """The time until it is answered, once it is the first."""
        expected_s = pace.expected_s(self.task.kind, self.task.views)
        if self.started == math.inf:
            return expected_s
        elapsed_s = time.monotonic() - self.started
        return elapsed_s * (1 / self.share - 1) if self.share > 0 else max(0.0, expected_s - elapsed_s)


class RequestQueue:
    """Computes tasks in its own thread: those of an API key in their order, and keys take turns.

    Each uses all cores, so two at once would take twice as long and twice the memory. At most ``most``
    different tasks are in the queue, and ``most_per_key`` of one API key.
    """

    def __init__(self, most: int, most_per_key: int) -> None:
        self._most, self._most_per_key = most, most_per_key
        self._changed = threading.Condition()
        self._queue: list[_Computation] = []
        """The first one is computed."""
        self._pace = Pace()
        threading.Thread(target=self._compute_all, daemon=True, name="rankings").start()

    def compute(self, task: Task, requester: Requester) -> tuple[Any, float]:
        """The task's answer, and the seconds that it waited for others; raises what the computation raises.

        ``LimitExceededError`` when the queue is full, or too long for an answer in time; ``DeadlineError``
        when the requester's time is up, ``RequesterGoneError`` when its connection has ended.
        """
        arrived, known = time.monotonic(), 0
        computation = self._enter(task, requester)
        try:
            while not wait((computation.answer,), _POLL_S).done:
                if requester.gone():
                    raise RequesterGoneError
                if time.monotonic() - arrived >= requester.timeout_s:
                    raise deadline_passed(requester.timeout_s)
                known = computation.pass_on(requester, known)
        finally:
            self._leave(computation, requester)
        answer = computation.answer.result()
        computation.pass_on(requester, known)
        return answer, max(0.0, computation.started - arrived)

    def wait_until_empty(self) -> None:
        """Wait until the queue is empty, for 2 s at most."""
        if self._queue:
            with self._changed:
                self._changed.wait_for(lambda: not self._queue, _LONGEST_PAUSE_S)

    def wait_for_request(self, timeout_s: float) -> bool:
        """Wait until the queue has a task, for ``timeout_s`` at most; returns whether it has one."""
        with self._changed:
            return bool(self._changed.wait_for(lambda: self._queue, timeout_s))

    @property
    def status(self) -> QueueStatus:
        """The state now."""
        with self._changed:
            computing = sum(computation.started < math.inf for computation in self._queue)
            return QueueStatus(
                waiting=len(self._queue) - computing, computing=computing, expected_s=self._expected_s()
            )

    def _enter(self, task: Task, requester: Requester) -> _Computation:
        with self._changed:
            for computation in self._queue:
                if computation.task.key == task.key and not computation.monitor.cancelled:
                    computation.requesters.add(requester)
                    return computation
            place = self._place(requester.api_key)
            self._require_room(task, requester, place)
            computation = _Computation(task, requester.api_key)
            computation.requesters.add(requester)
            self._queue.insert(place, computation)
            self._changed.notify_all()
            return computation

    def _place(self, api_key: str) -> int:
        """Where the next task of a key enters the queue: API keys take turns."""
        theirs = sum(computation.api_key == api_key for computation in self._queue)
        turns: Counter[str] = Counter()
        for index, computation in enumerate(self._queue):
            if turns[computation.api_key] > theirs and computation.started == math.inf:
                return index
            turns[computation.api_key] += 1
        return len(self._queue)

    def _require_room(self, task: Task, requester: Requester, place: int) -> None:
        theirs = [
            one for one in self._queue if any(other.api_key == requester.api_key for other in one.requesters)
        ]
        if len(self._queue) >= self._most:
            raise _full("The scene", len(self._queue), self._queue[0].left_s(self._pace))
        if len(theirs) >= self._most_per_key:
            raise _full("This API key", len(theirs), self._expected_s(self._queue.index(theirs[0]) + 1))
        waits_s = self._expected_s(place)
        late_s = waits_s + self._pace.expected_s(task.kind, task.views) - requester.timeout_s
        if place and late_s > 0:
            raise LimitExceededError(
                f"The rankings before this one take {waits_s:.0f} s, so it cannot be answered within "
                f"{requester.timeout_s:.0f} s.",
                hint="Try again later, or with fewer candidates.",
                retry_after_s=max(1, math.ceil(min(late_s, waits_s))),
            )

    def _expected_s(self, end: int | None = None) -> float:
        """The time until the queue is empty, or its first ``end`` tasks are answered."""
        return sum(computation.left_s(self._pace) for computation in self._queue[:end])

    def _leave(self, computation: _Computation, requester: Requester) -> None:
        with self._changed:
            computation.requesters.discard(requester)
            if computation.requesters or computation.answer.done():
                return
            computation.monitor.cancel()
            if computation.started == math.inf:
                self._queue.remove(computation)
                self._changed.notify_all()

    def _compute_all(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue)
                computation = self._queue[0]
                computation.started = time.monotonic()
            self._compute(computation)

    def _compute(self, computation: _Computation) -> None:
        task, answer, error = computation.task, None, None
        try:
            answer = task.compute(computation.monitor)
            computation.share = 1.0
        except Exception as raised:
            error = raised
        with self._changed:
            seconds = time.monotonic() - computation.started
            self._pace.add(task.kind, task.views * computation.share, seconds)
            self._queue.remove(computation)
            self._changed.notify_all()
        if error is None:
            computation.answer.set_result(answer)
        else:
            computation.answer.set_exception(error)


def _full(whose: str, queued: int, free_in_s: float) -> LimitExceededError:
    return LimitExceededError(
        f"{whose} has {queued} rankings in the queue, and no more are allowed.",
        hint="Try again when some of them are answered.",
        retry_after_s=max(1, math.ceil(free_in_s)),
    )
