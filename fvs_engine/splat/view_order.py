"""The order in which training takes its views."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray


@dataclass
class ViewOrder:
    """A random order of the views in each epoch, by the seed; ``remaining`` is popped from the end.

    View i comes ``repeats[i]`` times, spread over the epoch: a short run that covers only a part of it has
    each view about as often as the whole epoch promises.
    """

    seed: int
    epoch: int
    remaining: list[int]
    repeats: list[int]

    def copy(self) -> "ViewOrder":
        """The same order from here on."""
        return replace(self, remaining=list(self.remaining))

    def next(self) -> int:
        """The view of the next iteration."""
        if not self.remaining:
            rng = np.random.default_rng([self.seed, self.epoch])
            views = rng.permutation(np.repeat(np.arange(len(self.repeats)), self.repeats))
            self.remaining = _spread(views, np.array(self.repeats)).tolist()
            self.epoch += 1
        return self.remaining.pop()


def _spread(views: NDArray[np.int64], repeats: NDArray[np.int64]) -> NDArray[np.int64]:
    """Move the occurrences of each view apart: the k-th of r goes into the k-th of r equal parts.

    Views that come once keep their order.
    """
    number = np.arange(len(views))
    occurrence = np.empty_like(number)
    by_view = np.argsort(views, kind="stable")
    occurrence[by_view] = number - np.repeat(np.cumsum(repeats) - repeats, repeats)
    place = (occurrence + number / len(views)) / repeats[views]
    return views[np.argsort(place, kind="stable")]
