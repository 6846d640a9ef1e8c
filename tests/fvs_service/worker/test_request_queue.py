import threading
import time

import pytest
from fvs_service.worker.protocol.messages import StageProgress
from fvs_service.worker.runner.job_monitor import JobMonitor
from fvs_service.worker.runner.request_queue import RequestQueue

from fvs_engine.errors import Cancelled


def test_training_waits_for_a_request() -> None:
    requests, went_on = RequestQueue(), threading.Event()
    monitor = JobMonitor(lambda _stage: None, requests)
    with requests.turn():
        thread = threading.Thread(target=lambda: (monitor.check(), went_on.set()))
        thread.start()
        assert not went_on.wait(0.2)
    assert went_on.wait(1)
    thread.join()


def test_requests_go_one_by_one_in_the_order_of_arrival() -> None:
    requests, order, threads = RequestQueue(), [], []

    def ask(number: int) -> None:
        with requests.turn() as waited_s:
            order.append((number, waited_s > 0.01))

    with requests.turn():
        for number in range(5):
            threads.append(threading.Thread(target=ask, args=(number,)))
            threads[-1].start()
            while requests._arrived < number + 2:
                time.sleep(0.001)
        time.sleep(0.02)
        assert not order
    for thread in threads:
        thread.join()
    assert order == [(number, True) for number in range(5)]


def test_a_request_that_fails_lets_the_next_one_go() -> None:
    requests = RequestQueue()
    with pytest.raises(KeyError), requests.turn():
        raise KeyError
    with requests.turn() as waited_s:
        assert waited_s < 1


def test_requests_without_end_do_not_stop_training() -> None:
    requests = RequestQueue()
    with requests.turn():
        began = time.monotonic()
        JobMonitor(lambda _stage: None, requests).check()
        assert time.monotonic() - began < 5


def test_every_step_is_seen_but_not_every_step_is_reported() -> None:
    stages: list[StageProgress] = []
    steps: list[int] = []
    monitor = JobMonitor(stages.append, RequestQueue(), steps.append)
    for step in range(1, 101):
        monitor.report("train", step, 100, iterations_per_s=10.0)
    assert steps == list(range(1, 101))
    assert len(stages) < 10
    assert stages[0].eta_s == pytest.approx(9.9)


def test_a_stopped_job_stops_at_its_next_step() -> None:
    monitor = JobMonitor(lambda _stage: None, RequestQueue())
    monitor.cancel()
    with pytest.raises(Cancelled):
        monitor.check()
