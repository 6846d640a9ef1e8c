"""Held-out views: neither trained on nor visited, so that quality can be measured at them."""

from collections.abc import Sequence
from typing import Protocol, TypeVar

import numpy as np

from fvs_engine.choices import HoldOut
from fvs_engine.errors import InvalidInputError


class _Named(Protocol):
    @property
    def name(self) -> str: ...


NamedT = TypeVar("NamedT", bound=_Named)


_SEED = 0
"""Seed of a random choice: all runs on the same names hold out the same views."""


def hold_out(
    names: Sequence[str], every: int, choice: HoldOut = "every"
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split ``names``, sorted, into those to use and those held out: index % ``every`` == 0 is held out.

    With the ``choice`` ``random`` as many are drawn at random, the same ones whenever names are the same: a
    selector that spreads views evenly picks neighbours of every n-th one more often than chance. Nothing is
    held out when ``every`` is 0 or exceeds the number of names. Source: Mip-NeRF 360 (every 8th).

    Raises ``InvalidInputError`` for ``every`` of 1 or less than 0.
    """
    require_views_left(every)
    ordered = sorted(names)
    held_out = tuple(ordered[::every]) if every and len(ordered) >= every else ()
    if choice == "random":
        drawn = np.random.default_rng(_SEED).permutation(len(ordered))[: len(held_out)]
        held_out = tuple(ordered[index] for index in sorted(drawn.tolist()))
    return tuple(sorted(set(ordered) - set(held_out))), held_out


def hold_out_views(views: Sequence[NamedT], every: int) -> tuple[tuple[NamedT, ...], tuple[NamedT, ...]]:
    """Split ``views`` by name as ``hold_out`` splits names."""
    named = {view.name: view for view in views}
    used, held_out = hold_out(tuple(named), every)
    return tuple(named[name] for name in used), tuple(named[name] for name in held_out)


def require_views_left(every: int) -> None:
    """Raise ``InvalidInputError`` when holding out every ``every``-th view leaves none, or is impossible."""
    hint = "Hold out every 8th, or none with 0."
    if every == 1:
        raise InvalidInputError("Every view would be held out (--test-every 1), so none is left.", hint=hint)
    if every < 0:
        raise InvalidInputError(f"Every {every}th view cannot be held out.", hint=hint)
