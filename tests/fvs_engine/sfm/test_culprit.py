"""The search for the item that kills a job, on jobs that only pretend."""

import contextlib
from collections import defaultdict
from collections.abc import Callable, Sequence

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fvs_engine.errors import NativeJobError, ProcessDiedError
from fvs_engine.sfm.culprit import run_or_accuse


class Job:
    """Dies whenever ``kills`` says so; remembers its runs."""

    def __init__(self, kills: Callable[[Sequence[int]], bool], crashed: bool = True) -> None:
        self.kills, self.crashed = kills, crashed
        self.runs: list[Sequence[int]] = []

    def __call__(self, items: Sequence[int]) -> None:
        self.runs.append(list(items))
        if self.kills(items):
            how = "signal SIGSEGV" if self.crashed else "signal SIGKILL"
            raise ProcessDiedError("match", how, crashed=self.crashed)


@given(st.integers(2, 500), st.data(), st.booleans())
def test_one_culprit_is_found_in_a_few_runs(count: int, data: st.DataObject, crashed: bool):
    culprit = data.draw(st.integers(0, count - 1))
    job = Job(lambda items: culprit in items, crashed)
    accused = run_or_accuse(job, range(count))
    assert accused is not None
    assert accused[0] == culprit
    assert len(job.runs) <= 2 + 2 * count.bit_length() + 6
    assert job.runs.count([culprit]) >= (2 if crashed else 3)


def test_a_process_that_was_killed_once_accuses_nobody():
    deaths = iter([True])
    job = Job(lambda _items: next(deaths, False), crashed=False)
    assert run_or_accuse(job, range(100)) is None
    assert len(job.runs) == 2


@given(st.lists(st.booleans(), min_size=1, max_size=30), st.integers(1, 20))
@example([True, True, False, False, False, True, True, True], 2)
def test_kills_at_random_moments_accuse_only_who_dies_four_times_of_four(deaths: list[bool], count: int):
    remaining, died = iter(deaths), defaultdict(list)

    def kills(items: Sequence[int]) -> bool:
        died[tuple(items)].append(next(remaining, False))
        return died[tuple(items)][-1]

    try:
        accused = run_or_accuse(Job(kills, crashed=False), range(count))
    except NativeJobError:
        return
    if accused is not None:
        assert any(accused[0] in items and len(runs) >= 4 and all(runs) for items, runs in died.items())


@given(st.integers(0, 12), st.integers(1, 20))
def test_kills_do_not_change_the_order_in_which_items_are_first_done(kills: int, count: int):
    remaining = iter([True] * kills)
    job = Job(lambda _items: next(remaining, False), crashed=False)
    with contextlib.suppress(NativeJobError):
        run_or_accuse(job, range(count))
    done = dict.fromkeys(item for items in job.runs[kills:] for item in items)
    assert list(done) == sorted(done)


def test_a_machine_on_which_every_job_dies_accuses_nobody():
    with pytest.raises(ProcessDiedError):
        run_or_accuse(Job(lambda _items: True), range(10))


def test_a_single_image_is_accused_if_the_job_lives_on_others_or_crashes():
    assert run_or_accuse(Job(lambda items: 7 in items, crashed=False), [7], controls=[1]) is not None
    assert run_or_accuse(Job(lambda items: 7 in items), [7]) is not None
    with pytest.raises(ProcessDiedError):  # memory may just have run out
        run_or_accuse(Job(lambda _items: True, crashed=False), [7])


def test_of_two_that_kill_only_together_the_later_one_is_accused():
    accused = run_or_accuse(Job(lambda items: {3, 4} <= set(items)), range(6))
    assert accused is not None
    assert accused[0] == 4


def test_too_many_images_accuse_nobody():
    job = Job(lambda items: len(items) > 50)
    with pytest.raises(ProcessDiedError):
        run_or_accuse(job, range(100))
    assert len(job.runs) == 4
