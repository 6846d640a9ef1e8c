"""The choice between one thread and all, by a clock that the test moves."""

from collections.abc import Iterator

import numba
import pytest

from fvs_engine.compilation.faster_threads import FasterThreads

EVERY = 12
"""Steps from one trial of the other number of threads to the next."""


class Machine:
    """Steps take the seconds that it has for their number of threads."""

    def __init__(self, **seconds: float) -> None:
        self.now = 0.0
        self.seconds = {1: seconds["one"], 2: seconds["two"]}
        self.threads = FasterThreads(lambda: self.now)

    def step(self) -> int:
        """The number of threads that kernels have in one step."""
        with self.threads.step():
            threads = numba.get_num_threads()
            self.now += self.seconds[threads]
        return threads


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    before = numba.get_num_threads()
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("needs two threads: unset NUMBA_NUM_THREADS, on a machine with two processors")
    numba.set_num_threads(2)
    yield
    numba.set_num_threads(before)


def test_most_steps_have_the_faster_number_of_threads():
    quiet, busy = Machine(one=1.0, two=0.7), Machine(one=1.0, two=1.8)
    assert [quiet.step() for _ in range(2 * EVERY)] == [*[2] * (EVERY - 1), 1] * 2
    assert [busy.step() for _ in range(2 * EVERY)] == [*[2] * (EVERY - 1), *[1] * EVERY, 2]
    assert numba.get_num_threads() == 2


def test_the_choice_follows_the_machine():
    machine = Machine(one=1.0, two=0.7)
    for seconds, threads in ((1.8, 1), (0.7, 2)):
        machine.seconds[2] = seconds
        steps = [machine.step() for _ in range(6 * EVERY)]
        assert set(steps[-EVERY:-1]) == {threads}


def test_now_and_then_a_slow_step_counts():
    machine = Machine(one=1.0, two=0.7)
    steps = []
    for number in range(10 * EVERY):
        machine.seconds[2] = 12.0 if number % 5 == 0 else 0.7
        steps.append(machine.step())
    assert sum(threads == 1 for threads in steps) > 7 * EVERY


def test_a_first_step_that_takes_long_says_nothing_of_the_others():
    machine = Machine(one=1.0, two=40.0)
    machine.step()
    machine.seconds[2] = 0.7
    steps = [machine.step() for _ in range(10 * EVERY)]
    assert steps[-EVERY:].count(2) == EVERY - 1


def test_a_step_that_fails_leaves_the_threads_as_they_were():
    def fail(machine: Machine) -> None:
        with machine.threads.step():
            raise ZeroDivisionError

    machine = Machine(one=1.0, two=1.8)
    for _ in range(EVERY):
        machine.step()
    with pytest.raises(ZeroDivisionError):
        fail(machine)
    assert numba.get_num_threads() == 2
    assert machine.step() == 1


def test_with_one_thread_there_is_nothing_to_choose():
    numba.set_num_threads(1)
    threads = FasterThreads()
    for _ in range(2 * EVERY):
        with threads.step():
            assert numba.get_num_threads() == 1
