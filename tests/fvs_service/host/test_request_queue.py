import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest
from fvs_service.errors import DeadlineError, LimitExceededError
from fvs_service.host.protocol.messages import StageProgress
from fvs_service.host.runner.job_monitor import JobMonitor
from fvs_service.host.runner.request_queue import Pace, Requester, RequesterGoneError, RequestQueue, Task

from fvs_engine.errors import Cancelled
from fvs_engine.monitor import Monitor

SOON_S = 10.0


class Asking:
    """Threads that send requests to one queue, as the runner's connections do, computed view by view."""

    def __init__(self, pool: ThreadPoolExecutor) -> None:
        self.queue = RequestQueue(most=4, most_per_key=2)
        self.computed: list[str] = []
        self.stopped: list[str] = []
        self.steps: dict[str, threading.Semaphore] = {}
        self._pool = pool

    def task(self, key: str, views: int = 1) -> Task:
        steps = self.steps.setdefault(key, threading.Semaphore(0))

        def compute(monitor: Monitor) -> str:
            self.computed.append(key)
            for done in range(views):
                while not steps.acquire(timeout=0.005):
                    if monitor.cancelled:
                        self.stopped.append(key)
                        monitor.check()
                monitor.pass_on([f"{key}{done}"])
                monitor.report("score", done + 1, views)
            return f"answer to {key}"

        return Task(key, "median-frequency", views, compute)

    def ask(
        self,
        key: str,
        views: int = 1,
        api_key: str = "mine",
        timeout_s: float = 60.0,
        gone: Callable[[], bool] = lambda: False,
        pass_on: Callable[[Sequence[Any]], object] | None = None,
    ) -> "Future[Any]":
        """Send a request, and return once it is in the queue."""
        before = self.length
        joined = key in self.steps
        requester = Requester(api_key, timeout_s, gone, pass_on)
        asking = self._pool.submit(self.queue.compute, self.task(key, views), requester)
        until(lambda: asking.done() or self.length > before or joined)
        return asking

    @property
    def length(self) -> int:
        return self.queue.status.waiting + self.queue.status.computing

    def answer(self, key: str, views: int = 1) -> None:
        self.steps[key].release(views)


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + SOON_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.002)


@pytest.fixture
def asking() -> Asking:
    with ThreadPoolExecutor(16) as pool:
        yield Asking(pool)


def test_training_waits_for_a_request(asking: Asking) -> None:
    monitor, went_on = JobMonitor(lambda _stage: None, asking.queue), threading.Event()
    asked = asking.ask("a")
    thread = threading.Thread(target=lambda: (monitor.check(), went_on.set()))
    thread.start()
    assert not went_on.wait(0.2)
    asking.answer("a")
    assert went_on.wait(SOON_S)
    thread.join()
    assert asked.result()[0] == "answer to a"


def test_a_new_model_answers_its_first_request_before_training_continues(asking: Asking) -> None:
    monitor, went_on = JobMonitor(lambda _stage: None, asking.queue), threading.Event()
    thread = threading.Thread(target=lambda: (monitor.wait_for_first_requests(), went_on.set()))
    thread.start()
    time.sleep(0.2)  # somebody hears of the model
    asking.ask("a")
    assert not went_on.wait(1.2)
    asking.answer("a")
    assert went_on.wait(SOON_S)
    thread.join()


def test_a_model_without_requests_delays_training_a_moment(asking: Asking) -> None:
    began = time.monotonic()
    JobMonitor(lambda _stage: None, asking.queue).wait_for_first_requests()
    assert 0.9 < time.monotonic() - began < SOON_S


def test_a_stopped_job_waits_for_no_request(asking: Asking) -> None:
    monitor = JobMonitor(lambda _stage: None, asking.queue)
    monitor.cancel()
    with pytest.raises(Cancelled):
        monitor.wait_for_first_requests()


def test_requests_without_end_do_not_stop_training(asking: Asking) -> None:
    asking.ask("a")
    began = time.monotonic()
    JobMonitor(lambda _stage: None, asking.queue).check()
    assert 1 < time.monotonic() - began < SOON_S
    asking.answer("a")


def test_requests_of_a_key_are_computed_one_by_one_in_the_order_of_arrival(asking: Asking) -> None:
    asked = [asking.ask(key, api_key=key) for key in "abc"]
    until(lambda: asking.computed == ["a"])
    assert asking.queue.status.waiting == 2
    for key in "abc":
        asking.answer(key)
    assert [one.result()[0] for one in asked] == ["answer to a", "answer to b", "answer to c"]
    assert asking.computed == ["a", "b", "c"]
    assert all(one.result()[1] > 0 for one in asked[1:])


def test_api_keys_take_turns(asking: Asking) -> None:
    answers = [asking.ask(f"{key}{number}", api_key=key) for key in ("one", "other") for number in (1, 2)]
    for key in asking.steps:
        asking.answer(key)
    for answer in answers:
        answer.result(SOON_S)
    assert asking.computed == ["one1", "other1", "one2", "other2"]


def test_a_request_that_fails_lets_the_next_one_go(asking: Asking) -> None:
    def fail(_monitor: Monitor) -> None:
        raise KeyError("no such thing")

    with pytest.raises(KeyError):
        asking.queue.compute(Task("bad", "fisher", 1, fail), Requester("mine", 60.0, lambda: False))
    asking.steps["a"] = threading.Semaphore(1)
    assert asking.ask("a").result()[0] == "answer to a"


def test_equal_requests_are_computed_once(asking: Asking) -> None:
    asked = [asking.ask("a", api_key=str(number)) for number in range(8)]
    assert asking.length == 1
    asking.answer("a")
    assert {one.result()[0] for one in asked} == {"answer to a"}
    assert asking.computed == ["a"]


def test_every_requester_gets_all_results_before_the_answer(asking: Asking) -> None:
    first: list[str] = []
    later: list[str] = []
    asked = [asking.ask("a", views=5, pass_on=first.extend)]
    asking.answer("a", 2)
    until(lambda: first == ["a0", "a1"])
    asked += [asking.ask("a", pass_on=later.extend), asking.ask("a")]
    until(lambda: later == ["a0", "a1"])
    asking.answer("a", 3)
    assert {one.result(SOON_S)[0] for one in asked} == {"answer to a"}
    assert first == later == [f"a{number}" for number in range(5)]


def test_a_computation_stops_only_when_all_requesters_are_gone(asking: Asking) -> None:
    gone = [threading.Event(), threading.Event()]
    asked = [asking.ask("a", views=100, gone=one.is_set) for one in gone]
    until(lambda: asking.computed == ["a"])
    gone[0].set()
    with pytest.raises(RequesterGoneError):
        asked[0].result(SOON_S)
    asking.answer("a")
    time.sleep(0.05)
    assert not asking.stopped
    gone[1].set()
    with pytest.raises(RequesterGoneError):
        asked[1].result(SOON_S)
    until(lambda: asking.stopped == ["a"] and asking.length == 0)


def test_a_request_that_waits_is_dropped_with_its_requester(asking: Asking) -> None:
    gone = threading.Event()
    first, second = asking.ask("a"), asking.ask("b", gone=gone.is_set)
    gone.set()
    with pytest.raises(RequesterGoneError):
        second.result(SOON_S)
    assert asking.length == 1
    asking.answer("a")
    first.result(SOON_S)
    assert asking.computed == ["a"]


def test_a_request_that_waits_is_dropped_at_its_deadline(asking: Asking) -> None:
    first = asking.ask("a")
    with pytest.raises(DeadlineError):
        asking.ask("b", timeout_s=0.1).result(SOON_S)
    assert asking.length == 1
    asking.answer("a")
    first.result(SOON_S)
    assert asking.computed == ["a"]


def test_a_computation_is_stopped_at_its_deadline(asking: Asking) -> None:
    with pytest.raises(DeadlineError):
        asking.ask("a", views=100, timeout_s=0.3).result(SOON_S)
    until(lambda: asking.length == 0)
    # On a machine that is too busy to begin in time there is nothing to stop.
    assert asking.stopped == asking.computed


def test_a_request_repeated_after_hanging_up_gets_a_computation_that_is_not_stopped(asking: Asking) -> None:
    gone = threading.Event()
    first = asking.ask("a", gone=gone.is_set)
    until(lambda: asking.computed == ["a"])
    gone.set()
    with pytest.raises(RequesterGoneError):
        first.result(SOON_S)
    again = asking.ask("a")
    until(lambda: asking.computed == ["a", "a"])
    asking.answer("a")
    assert again.result(SOON_S)[0] == "answer to a"


def test_the_queue_is_bounded_per_key_and_per_scene(asking: Asking) -> None:
    asked = [asking.ask(f"{key}{number}", api_key=key) for key in "xy" for number in range(2)]
    for key, message in (("x", "The scene has 4"), ("z", "The scene has 4")):
        with pytest.raises(LimitExceededError, match=message):
            asking.ask("more", api_key=key).result(SOON_S)
    asking.answer("x0")
    asked[0].result(SOON_S)
    with pytest.raises(LimitExceededError, match="This API key has 2") as refused:
        asking.ask("more", api_key="y").result(SOON_S)
    assert refused.value.retry_after_s >= 1
    for key in ("y0", "x1", "y1"):
        asking.answer(key)


def test_retry_after_is_when_the_queue_has_room_again(asking: Asking) -> None:
    asking.queue._pace.add("median-frequency", 1, 10.0)  # 10 s per view
    asked = [asking.ask(key, views=2) for key in "ab"]
    until(lambda: asking.computed == ["a"])
    with pytest.raises(LimitExceededError) as refused:
        asking.ask("c").result(SOON_S)
    assert 15 <= refused.value.retry_after_s <= 20  # until "a" is answered
    with pytest.raises(LimitExceededError, match="cannot be answered within 12 s") as refused:
        asking.ask("d", api_key="other", views=1, timeout_s=12.0).result(SOON_S)
    assert 13 <= refused.value.retry_after_s <= 18  # 20 s for the one before, 10 s for it
    assert asking.length == 2
    for key in "ab":
        asking.answer(key, 2)
    for one in asked:
        one.result(SOON_S)


def test_a_request_that_takes_long_is_computed_when_nobody_waits_before_it(asking: Asking) -> None:
    asking.queue._pace.add("median-frequency", 1, 1000.0)
    asking.steps["a"] = threading.Semaphore(1)
    assert asking.ask("a", timeout_s=60.0).result(SOON_S)[0] == "answer to a"


def test_the_pace_is_that_of_the_same_kind() -> None:
    pace = Pace()
    assert pace.expected_s("fisher", 10) == 0
    pace.add("fisher", 10, 20.0)
    pace.add("coverage", 10, 1.0)
    assert pace.expected_s("fisher", 5) == pytest.approx(10.0)
    assert pace.expected_s("coverage", 5) == pytest.approx(0.5)
    assert pace.expected_s("unknown", 5) == pytest.approx(10.0)
    for _ in range(40):
        pace.add("fisher", 10, 10.0)
    assert pace.expected_s("fisher", 5) == pytest.approx(5.0, rel=1e-3)


def test_not_every_step_is_reported() -> None:
    stages: list[StageProgress] = []
    monitor = JobMonitor(stages.append, RequestQueue(1, 1))
    for step in range(1, 101):
        monitor.report("training", step, 100, iterations_per_s=10.0)
    assert len(stages) < 10
    assert stages[0].share == pytest.approx(0.01)


def test_a_stopped_job_stops_at_its_next_step() -> None:
    monitor = JobMonitor(lambda _stage: None, RequestQueue(1, 1))
    monitor.cancel()
    with pytest.raises(Cancelled):
        monitor.check()
