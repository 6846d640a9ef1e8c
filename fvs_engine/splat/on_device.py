"""Work on a device: torch's threads beside the kernels of the CPU, and what it means when a GPU is full."""

import traceback
from collections.abc import Iterator
from contextlib import contextmanager

import torch

from fvs_engine.errors import DeviceMemoryError

_SAID_OTHERWISE = (
    "CUDA error: out of memory",
    "CUDA driver error: out of memory",
    "Triton Error [CUDA]: out of memory",
    "CUFFT_ALLOC_FAILED",
    "CUBLAS_STATUS_ALLOC_FAILED",
)
"""What says that a GPU has no memory left, beside torch's ``OutOfMemoryError``."""


@contextmanager
def on_device(device: torch.device) -> Iterator[None]:
    """Train or render on ``device``, of which the kernels use all.

    On the CPU torch has one thread, because the kernels use the cores. Raises ``DeviceMemoryError`` when the
    memory of a GPU has run out; what the failed work held is then free.
    """
    before = torch.get_num_threads()
    if device.type == "cpu":
        torch.set_num_threads(1)
    try:
        yield
    except RuntimeError as error:
        if not isinstance(error, torch.OutOfMemoryError) and not any(
            words in str(error) for words in _SAID_OTHERWISE
        ):
            raise
        traceback.clear_frames(error.__traceback__)  # they hold tensors
        raise DeviceMemoryError(
            "The memory of the GPU has run out. What was finished and the last checkpoint are kept.",
            hint="Try again while no other program uses the GPU, or with fewer Gaussians or smaller images.",
        ) from error
    finally:
        torch.set_num_threads(before)
