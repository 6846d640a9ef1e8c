import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.lab.evaluate.protocol import PRESETS, Protocol, protocol_from_preset


def test_the_presets_are_what_their_names_promise() -> None:
    paper, fisherrf, nearest5 = (PRESETS[name] for name in ("paper", "fisherrf", "nearest5"))
    assert (paper.initial, paper.initial_choice, paper.reach) == (10, "first", "radius")
    assert (paper.budget, paper.poses) == (100, "sfm")
    assert (paper.initial_iterations, paper.iterations_per_view) == (1_000, 100)
    assert (fisherrf.initial, fisherrf.initial_choice, fisherrf.reach) == (4, "farthest", "all")
    assert (fisherrf.budget, fisherrf.poses) == (20, "known")
    assert (nearest5.reach, nearest5.nearest, nearest5.poses) == ("nearest", 5, "known")
    assert {protocol.test_every for protocol in PRESETS.values()} == {8}
    assert {name: protocol.name for name, protocol in PRESETS.items()} == {name: name for name in PRESETS}


def test_every_number_can_be_changed_and_none_leaves_it() -> None:
    protocol = protocol_from_preset("fisherrf", view_counts=(6, 12), initial=5, long_side_px=None)
    assert (protocol.budget, protocol.initial) == (12, 5)
    assert protocol.long_side_px == PRESETS["fisherrf"].long_side_px


@pytest.mark.parametrize(
    ("changes", "reach"), [({"radius": 2.0}, "radius"), ({"nearest": 7}, "nearest"), ({}, "nearest")]
)
def test_a_limit_given_replaces_the_preset_s(changes: dict[str, float], reach: str) -> None:
    protocol = protocol_from_preset("nearest5", **changes)
    assert protocol.reach == reach
    assert protocol.radius == changes.get("radius")
    assert protocol.nearest == (None if reach == "radius" else changes.get("nearest", 5))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"view_counts": (20, 10)}, "rise"),
        ({"view_counts": (2, 10)}, "no less than the 4 initial"),
        ({"view_counts": ()}, "view_counts"),
        ({"radius": 1.0, "nearest": 2}, "one of the three"),
        ({"radius": float("nan")}, "radius"),
        ({"long_side_px": 3}, "long_side_px"),
    ],
)
def test_numbers_that_cannot_be_used_are_named(changes: dict[str, object], problem: str) -> None:
    with pytest.raises(InvalidInputError, match=problem):
        protocol_from_preset("fisherrf", **changes)


def test_an_unknown_preset_gets_the_names_of_all() -> None:
    with pytest.raises(InvalidInputError) as caught:
        protocol_from_preset("fisher")
    assert all(name in caught.value.hint for name in PRESETS)


def test_a_protocol_survives_json() -> None:
    for protocol in PRESETS.values():
        assert Protocol.model_validate_json(protocol.model_dump_json()) == protocol
