from dataclasses import dataclass

import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.hold_out import hold_out, hold_out_views

NAMES = tuple(f"{index:02d}.jpg" for index in range(20))


@dataclass(frozen=True)
class Named:
    name: str


def test_every_eighth_by_name_is_held_out() -> None:
    used, held_out = hold_out(NAMES[::-1], 8)
    assert held_out == ("00.jpg", "08.jpg", "16.jpg")
    assert used == tuple(name for name in NAMES if name not in held_out)


def test_as_many_are_drawn_at_random_and_always_the_same() -> None:
    used, held_out = hold_out(NAMES[::-1], 8, "random")
    assert len(held_out) == 3
    assert (used, held_out) == hold_out(NAMES, 8, "random")
    assert sorted((*used, *held_out)) == list(NAMES)
    assert held_out != hold_out(NAMES, 8)[1]


@pytest.mark.parametrize("every", [0, 21])
def test_none_or_too_few_to_hold_out_any(every: int) -> None:
    assert hold_out(NAMES, every) == (NAMES, ())
    assert hold_out(NAMES, every, "random") == (NAMES, ())


def test_views_are_split_by_their_names() -> None:
    views = tuple(map(Named, NAMES))
    used, held_out = hold_out_views(views[::-1], 4)
    assert held_out == views[::4]
    assert used == tuple(view for view in views if view not in held_out)


@pytest.mark.parametrize("every", [1, -8])
def test_what_leaves_no_views_is_refused(every: int) -> None:
    with pytest.raises(InvalidInputError, match="held out"):
        hold_out(NAMES, every)
