"""The queue of a scene's rankings and renders: one is computed at a time, before training.

A question is computed once for all who ask it while it is queued or computed, each over a connection of its
own. When the last of them has hung up, or its time is up, it leaves the queue, or stops between two views.
"""

import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass
from typing import Any

from fvs_engine.monitor import Monitor, Progress
from fvs_engine.records import Record
from fvs_service.errors import LimitExceededError, deadline_passed
from fvs_service.worker.runner.pace import Pace

_LONGEST_PAUSE_S = 2.0
"""Training makes a step at least this often, however many requests arrive."""
_POLL_S = 0.1


@dataclass(frozen=True)
class Question:
    """What to compute: ``views`` of one ``kind``, whose pace is measured. Equal keys have equal answers."""

    key: str
    kind: str
    views: int
    compute: Callable[[Monitor], Any]


@dataclass(frozen=True, eq=False)
class Asker:
    """Who asks: with which API key, for how long, and whether the connection has ended since.

    ``pass_on`` gets the results that are known before the answer, in the thread that asks.
    """

    api_key: str
    timeout_s: float
    gone: Callable[[], bool]
    pass_on: Callable[[Sequence[Any]], object] | None = None


class AskerGoneError(Exception):
    """The connection over which the question came has ended: the answer has no receiver."""


class QueueStatus(Record):
    """The state of a queue: questions that wait, that are computed, and the time until all are answered."""

    waiting: int
    computing: int
    expected_s: float


class _Computation:
    """A question in the queue, and those who wait for its answer."""

    def __init__(self, question: Question) -> None:
        self.question = question
        self.askers: set[Asker] = set()
        self.answer: Future[Any] = Future()
        self.results: list[Any] = []
        """The results that are known so far."""
        self.monitor = Monitor(self._on_progress, self.results.extend)
        self.started = math.inf
        self.share = 0.0

    def _on_progress(self, progress: Progress) -> None:
        if progress.share is not None and progress.stage != "compile":
            self.share = progress.share

    def pass_on(self, asker: Asker, known: int) -> int:
        """Pass the results after the first ``known`` on to an asker; returns how many there are."""
        results = self.results[known:]
        if results and asker.pass_on is not None:
            asker.pass_on(results)
        return known + len(results)

    def left_s(self, pace: Pace) -> float:
        """The time until it is answered, once it is the first."""
        expected_s = pace.expected_s(self.question.kind, self.question.views)
        if self.started == math.inf:
            return expected_s
        elapsed_s = time.monotonic() - self.started
        return elapsed_s * (1 / self.share - 1) if self.share > 0 else max(0.0, expected_s - elapsed_s)


class RequestQueue:
    """Computes questions first in, first out, in a thread of its own.

    Each uses all cores, so two at once would take twice as long and twice the memory. At most ``most``
    different questions are in the queue, and ``most_per_key`` of one API key.
    """

    def __init__(self, most: int, most_per_key: int) -> None:
        self._most, self._most_per_key = most, most_per_key
        self._changed = threading.Condition()
        self._queue: list[_Computation] = []
        """The first one is computed."""
        self._pace = Pace()
        threading.Thread(target=self._compute_all, daemon=True, name="rankings").start()

    def ask(self, question: Question, asker: Asker) -> tuple[Any, float]:
        """The answer, and the seconds that it waited for others. Raises what the computation raises.

        ``LimitExceededError`` when the queue is too long, also to be answered in time; ``DeadlineError``
        when the asker's time is up, ``AskerGoneError`` when its connection does.
        """
        arrived, known = time.monotonic(), 0
        computation = self._enter(question, asker)
        try:
            while not wait((computation.answer,), _POLL_S).done:
                if asker.gone():
                    raise AskerGoneError
                if time.monotonic() - arrived >= asker.timeout_s:
                    raise deadline_passed(asker.timeout_s)
                known = computation.pass_on(asker, known)
        finally:
            self._leave(computation, asker)
        answer = computation.answer.result()
        computation.pass_on(asker, known)
        return answer, max(0.0, computation.started - arrived)

    def wait_until_empty(self) -> None:
        """Wait until no question is left, but for 2 s at most."""
        if self._queue:
            with self._changed:
                self._changed.wait_for(lambda: not self._queue, _LONGEST_PAUSE_S)

    def wait_for_question(self, timeout_s: float) -> bool:
        """Wait until there is a question, but for ``timeout_s`` at most; returns whether there is one."""
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

    def _enter(self, question: Question, asker: Asker) -> _Computation:
        with self._changed:
            for computation in self._queue:
                if computation.question.key == question.key and not computation.monitor.cancelled:
                    computation.askers.add(asker)
                    return computation
            self._require_room(question, asker)
            computation = _Computation(question)
            computation.askers.add(asker)
            self._queue.append(computation)
            self._changed.notify_all()
            return computation

    def _require_room(self, question: Question, asker: Asker) -> None:
        theirs = [one for one in self._queue if any(other.api_key == asker.api_key for other in one.askers)]
        if len(self._queue) >= self._most:
            raise _full("The scene", len(self._queue), self._queue[0].left_s(self._pace))
        if len(theirs) >= self._most_per_key:
            raise _full("This API key", len(theirs), self._expected_s(until=theirs[0]))
        waits_s = self._expected_s()
        late_s = waits_s + self._pace.expected_s(question.kind, question.views) - asker.timeout_s
        if self._queue and late_s > 0:
            raise LimitExceededError(
                f"The rankings before this one take {waits_s:.0f} s, so it cannot be answered within "
                f"{asker.timeout_s:.0f} s.",
                hint="Ask again later, or for fewer candidates.",
                retry_after_s=max(1, math.ceil(min(late_s, waits_s))),
            )

    def _expected_s(self, until: _Computation | None = None) -> float:
        """The time until the queue is empty, or ``until`` is answered."""
        end = len(self._queue) if until is None else self._queue.index(until) + 1
        return sum(computation.left_s(self._pace) for computation in self._queue[:end])

    def _leave(self, computation: _Computation, asker: Asker) -> None:
        with self._changed:
            computation.askers.discard(asker)
            if computation.askers or computation.answer.done():
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
        question, answer, error = computation.question, None, None
        try:
            answer = question.compute(computation.monitor)
            computation.share = 1.0
        except Exception as raised:
            error = raised
        with self._changed:
            seconds = time.monotonic() - computation.started
            self._pace.add(question.kind, question.views * computation.share, seconds)
            self._queue.remove(computation)
            self._changed.notify_all()
        if error is None:
            computation.answer.set_result(answer)
        else:
            computation.answer.set_exception(error)


def _full(whose: str, questions: int, free_in_s: float) -> LimitExceededError:
    return LimitExceededError(
        f"{whose} has {questions} rankings in the queue, and no more are allowed.",
        hint="Ask again when some of them are answered.",
        retry_after_s=max(1, math.ceil(free_in_s)),
    )
