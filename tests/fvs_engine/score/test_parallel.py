import threading
from collections.abc import Iterator

import numba
import pytest
import torch

from fvs_engine.errors import Cancelled
from fvs_engine.monitor import Monitor
from fvs_engine.score import MedianFrequency
from fvs_engine.score.parallel import map_in_order
from fvs_engine.splat.raster import Rasterizer, create_rasterizer

CPU = torch.device("cpu")


@pytest.fixture
def two_threads() -> Iterator[None]:
    before = numba.get_num_threads()
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("needs two threads: unset NUMBA_NUM_THREADS, on a machine with two processors")
    numba.set_num_threads(2)
    yield
    numba.set_num_threads(before)


@pytest.fixture(scope="module")
def rasterizer() -> Rasterizer:
    return create_rasterizer("cpu")


@pytest.mark.usefixtures("two_threads")
def test_items_overlap_with_one_kernel_thread_each_and_results_keep_their_order() -> None:
    both = threading.Barrier(2, timeout=20)

    def function(item: int) -> tuple[int, int]:
        both.wait()  # breaks if one item must end before the other begins
        return item, numba.get_num_threads()

    assert list(map_in_order(function, [3, 1, 2, 0], CPU)) == [(3, 1), (1, 1), (2, 1), (0, 1)]
    assert numba.get_num_threads() == 2


@pytest.mark.usefixtures("two_threads")
def test_a_single_item_and_a_gpu_have_the_threads_of_the_caller() -> None:
    assert list(map_in_order(lambda _: numba.get_num_threads(), ["only"], CPU)) == [2]
    names = map_in_order(lambda _: threading.current_thread(), [1, 2], torch.device("cuda"))
    assert set(names) == {threading.current_thread()}


@pytest.mark.usefixtures("two_threads")
def test_an_exception_leaves_out_what_has_not_begun() -> None:
    begun = []

    def function(item: int) -> int:
        begun.append(item)
        if item == 0:
            raise ZeroDivisionError
        threading.Event().wait(0.05)
        return item

    with pytest.raises(ZeroDivisionError):
        list(map_in_order(function, range(100), CPU))
    assert len(begun) < 100


@pytest.mark.usefixtures("two_threads")
def test_scores_and_their_order_are_those_of_one_thread(ball, candidate_at, rasterizer) -> None:
    candidates = [candidate_at(str(number), (3, 0, 0.1 * number)) for number in range(9)]
    passed_on = []
    monitor = Monitor(on_results=passed_on.extend)
    scores = MedianFrequency().score(ball, candidates, rasterizer, monitor=monitor)
    assert tuple(passed_on) == scores
    numba.set_num_threads(1)
    assert MedianFrequency().score(ball, candidates, rasterizer) == scores


@pytest.mark.usefixtures("two_threads")
def test_a_stop_ends_all_threads(ball, candidate_at, rasterizer) -> None:
    candidates = [candidate_at(str(number), (3, 0, 0.1 * number)) for number in range(200)]
    monitor = Monitor(lambda progress: monitor.cancel() if progress.stage == "score" else None)
    with pytest.raises(Cancelled):
        MedianFrequency().score(ball, candidates, rasterizer, monitor=monitor)
