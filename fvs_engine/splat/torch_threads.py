"""The number of torch's threads beside the kernels."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def torch_threads_for(device: torch.device) -> Iterator[None]:
    """Limit torch to one thread on the CPU, whose cores the kernels use."""
    before = torch.get_num_threads()
    if device.type == "cpu":
        torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
