import threading
import time

import pytest
from fvs_service.worker.protocol import ProgressNote
from fvs_service.worker.runner.pace import JobMonitor, Pace

from fvs_engine.errors import Cancelled


def test_learning_waits_while_a_question_is_answered() -> None:
    pace, went_on = Pace(), threading.Event()
    monitor = JobMonitor(lambda _note: None, pace)
    with pace.answering():
        thread = threading.Thread(target=lambda: (monitor.check(), went_on.set()))
        thread.start()
        assert not went_on.wait(0.2)
    assert went_on.wait(1)
    thread.join()


def test_questions_are_answered_one_by_one_in_the_order_in_which_they_came() -> None:
    pace, order, threads = Pace(), [], []

    def ask(number: int) -> None:
        with pace.answering() as waited_s:
            order.append((number, waited_s > 0.01))

    with pace.answering():
        for number in range(5):
            threads.append(threading.Thread(target=ask, args=(number,)))
            threads[-1].start()
            while pace._came < number + 2:
                time.sleep(0.001)
        time.sleep(0.02)
        assert not order
    for thread in threads:
        thread.join()
    assert order == [(number, True) for number in range(5)]


def test_a_question_that_fails_lets_the_next_one_go() -> None:
    pace = Pace()
    with pytest.raises(KeyError), pace.answering():
        raise KeyError
    with pace.answering() as waited_s:
        assert waited_s < 1


def test_questions_without_end_do_not_stop_learning() -> None:
    pace = Pace()
    with pace.answering():
        began = time.monotonic()
        JobMonitor(lambda _note: None, pace).check()
        assert time.monotonic() - began < 5


def test_every_step_is_seen_but_not_every_step_is_told() -> None:
    notes: list[ProgressNote] = []
    steps: list[int] = []
    monitor = JobMonitor(notes.append, Pace(), steps.append)
    for step in range(1, 101):
        monitor.report("train", step, 100, iterations_per_s=10.0)
    assert steps == list(range(1, 101))
    assert len(notes) < 10
    assert notes[0].eta_s == pytest.approx(9.9)


def test_a_stopped_job_stops_at_its_next_step() -> None:
    monitor = JobMonitor(lambda _note: None, Pace())
    monitor.cancel()
    with pytest.raises(Cancelled):
        monitor.check()
