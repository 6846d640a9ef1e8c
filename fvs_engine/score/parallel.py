"""Views measured at the same time, each by one thread of a CPU.

The threads of a kernel wait for each other at its end, dozens of times per view. Alone on two cores a view is
then measured 1.4 times as fast as by one thread. Beside a process that keeps one core busy it takes three
times as long, because the scheduler delays the kernel's second thread. Views do not wait for each other.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numba
import torch

Item = TypeVar("Item")
Result = TypeVar("Result")


def map_in_order(
    function: Callable[[Item], Result], items: Sequence[Item], device: torch.device
) -> Iterator[Result]:
    """The results of ``function``, in the order of ``items``.

    On a CPU it is called in as many threads as kernels may use here, and kernels use one thread in each of
    them. The first exception ends it: items that have not begun are left out. Results are held until they are
    consumed, so they should be small.
    """
    threads = min(numba.get_num_threads(), len(items))
    if device.type != "cpu" or threads < 2:
        yield from map(function, items)
        return
    with ThreadPoolExecutor(threads, "views", initializer=_use_one_thread) as executor:
        yield from executor.map(function, items)


def _use_one_thread() -> None:
    numba.set_num_threads(1)
