"""The guard of a training: int32 [2] on the device, set and read by kernels so that the host need not wait.

The host launches a step and, while the device computes it, the next one. So it learns of a failure a step too
late: of an image with more hits than room was made for, or of a loss that is not finite. ``guard[REASON]`` is
0, or why the training halted; ``guard[HITS_NEEDED]`` is how many hits the view needed that overflowed. While
it is set, no kernel changes parameters, moments or statistics: the step that set it and those queued behind
it do nothing, until the host has read the guard and either repeats them with more room or reports a failure.
How much room there was does not influence the result.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from fvs_engine.errors import DeviceMemoryError

REASON, HITS_NEEDED = 0, 1
GUARD_SIZE = 2

HALTED_OVERFLOW = 1
"""A view needed more hits than there was room for."""
HALTED_NOT_FINITE = 2
"""The loss was not finite."""

_SPARE = 1.25
"""Room for this multiple of the hits that were needed."""

MOST_HITS = (1 << 31) - (1 << 17)
"""Kernels count hits in int32, up to a stride of their programs past the last; torch sorts no more either."""


def new_guard(device: torch.device) -> Tensor:
    """A guard that is not set."""
    return torch.zeros(GUARD_SIZE, dtype=torch.int32, device=device)


def check_hits(needed: int) -> None:
    """Raise ``DeviceMemoryError`` for more hits than kernels can count."""
    if needed > MOST_HITS:
        raise DeviceMemoryError(
            f"An image, or those rendered at once, would need {needed} hits of Gaussians in tiles.",
            hint="Use smaller images, or a model whose Gaussians are smaller or fewer.",
        )


@dataclass(frozen=True)
class StepReport:
    """The outcome of a step: its ``loss`` before it, and why it changed nothing, if so."""

    loss: float
    overflowed: bool
    diverged: bool
    needed: int


class StepGuard:
    """The guard of a training as the host sees it: ``words`` int32 [2] on the device.

    ``capacity``: the hits that there is room for; None before the first image.
    """

    def __init__(self, device: torch.device) -> None:
        self.words = new_guard(device)
        self.capacity: int | None = None

    def make_room(self, needed: int) -> None:
        """Make room for more than ``needed`` hits, from the next image on."""
        check_hits(needed)
        self.capacity = max(self.capacity or 0, min(int(_SPARE * needed) + 1, MOST_HITS))

    def reset(self) -> None:
        """Let steps change the model again."""
        self.words.zero_()

    def report(self, loss: Tensor) -> "PendingReport":
        """The report of the step that was launched last, whose loss [] is on the device."""
        return PendingReport(torch.cat([loss.detach().view(1).view(torch.int32), self.words]))


class PendingReport:
    """A report that is being copied from the device: int32 ``words`` [3], the first the bits of the loss."""

    def __init__(self, words: Tensor) -> None:
        self._arrived = None
        self._words = words
        if words.device.type == "cuda":
            self._words = torch.empty(3, dtype=torch.int32, pin_memory=True)
            self._words.copy_(words, non_blocking=True)
            self._arrived = torch.cuda.Event()
            self._arrived.record()

    def wait(self) -> StepReport:
        """Wait for the step to end on the device."""
        if self._arrived is not None:
            self._arrived.synchronize()
        reason, needed = self._words[1:].tolist()
        loss = self._words[:1].view(torch.float32).item()
        return StepReport(loss, reason == HALTED_OVERFLOW, reason == HALTED_NOT_FINITE, needed)
