"""The guard of a training: int32 [2] on the device, set and read by kernels so that the host need not wait.

``guard[REASON]`` is 0, or why the training halted; ``guard[HITS_NEEDED]`` is how many hits the view needed
that overflowed. While it is set, no kernel changes parameters, moments or statistics: the step that set it
and those that were queued behind it do nothing, until the host has read the guard, acted, and zeroed it.
"""

import torch
from torch import Tensor

REASON, HITS_NEEDED = 0, 1
GUARD_SIZE = 2

HALTED_OVERFLOW = 1
"""A view needed more hits than there was room for."""
HALTED_NOT_FINITE = 2
"""The loss was not finite."""


def new_guard(device: torch.device) -> Tensor:
    """A guard that is not set."""
    return torch.zeros(GUARD_SIZE, dtype=torch.int32, device=device)
