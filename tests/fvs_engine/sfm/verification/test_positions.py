from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import SimilarityTransform
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.verification.positions import contradict, misplaced, residual_share, usable_priors
from fvs_schema.findings import Finding, FindingCode

WORLD_FROM_MODEL = SimilarityTransform(
    3.0, Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([5.0, -2.0, 9.0])
)

Places = dict[str, np.ndarray]


def orbit(count: int, radius: float = 10.0) -> Places:
    angles = np.linspace(0.0, 2.0, count)
    return {f"{k:02}": radius * np.array([np.cos(a), np.sin(a), 0.1 * k]) for k, a in enumerate(angles)}


def priors(places: Places, sigma: float = 0.0) -> PosePriors:
    return PosePriors(by_name={name: PosePrior.at(place, sigma) for name, place in places.items()})


def in_world(centres: Places) -> Places:
    return {name: WORLD_FROM_MODEL.apply(centre) for name, centre in centres.items()}


@given(st.integers(6, 30), st.integers(0, 29))
def test_a_camera_elsewhere_is_accused_and_no_other(count: int, which: int):
    centres = orbit(count)
    places = in_world(centres)
    assert misplaced(priors(places), centres) == {}
    accused = f"{which % count:02}"
    away = places | {accused: places[accused] + np.array([0.0, 0.0, 40.0])}
    found = misplaced(priors(away), centres)
    assert found == {accused: pytest.approx(40.0)}


def test_noise_accuses_nobody_and_hides_no_blunder():
    centres = orbit(20)
    noise = np.random.default_rng(0).normal(scale=1.0, size=(20, 3))
    places = {
        name: place + error for (name, place), error in zip(in_world(centres).items(), noise, strict=True)
    }
    assert misplaced(priors(places), centres) == {}
    places["07"] = places["07"] + np.array([0.0, 0.0, 25.0])
    assert set(misplaced(priors(places), centres)) == {"07"}


def test_noise_of_cameras_side_by_side_accuses_nobody_far_from_them():
    """A robust alignment by seven in a row alone is off by much at the other two."""
    centres = {f"{k}": np.array([0.02 * k, 0.006 * (k % 2), 0.0]) for k in range(7)}
    centres |= {"7": np.array([1.0, 0.6, 0.1]), "8": np.array([1.2, 1.1, -0.2])}
    for seed in range(40):
        draw = np.random.default_rng(seed)
        places = {name: centre + draw.normal(scale=0.02, size=3) for name, centre in centres.items()}
        assert misplaced(priors(places, 0.02), centres) == {}


def test_a_few_positions_and_inaccurate_ones_say_nothing():
    centres = orbit(20)
    away = in_world(centres) | {"03": np.array([500.0, 0.0, 0.0])}
    few = {name: away[name] for name in ("00", "01", "02", "03", "04")}
    assert misplaced(priors(few), centres) == {}
    assert misplaced(priors(away, 5.0), centres) == {}  # the orbit is 20 wide
    assert residual_share(priors(away, 5.0), centres) is None
    assert set(misplaced(priors(away, 1.0), centres)) == {"03"}
    assert misplaced(PosePriors(), centres) == {}


def test_the_residual_tells_a_wrong_model_from_a_right_one():
    centres = orbit(20)
    known = priors(in_world(centres))
    assert residual_share(known, centres) == pytest.approx(0.0, abs=1e-9)
    order = np.random.default_rng(0).permutation(20)
    mixed = {name: list(centres.values())[order[k]] for k, name in enumerate(centres)}
    share = residual_share(known, mixed)
    assert share is not None
    assert share > 0.25


def test_positions_contradict_when_hardly_any_fits_and_not_for_a_few_that_are_wrong():
    centres = orbit(20)
    places = in_world(centres)
    assert not contradict(priors(places), centres)
    away = {name: place + np.array([0.0, 0.0, 40.0]) for name, place in list(places.items())[:5]}
    assert not contradict(priors(places | away), centres)
    away = {
        name: place + np.array([0.0, 40.0, 40.0]) * k
        for k, (name, place) in enumerate(places.items())
        if k % 5 < 2
    }
    assert contradict(priors(places | away), centres)
    shuffled = dict(zip(places, np.random.default_rng(0).permutation(list(places.values())), strict=True))
    assert contradict(priors(shuffled), centres)
    assert not contradict(PosePriors(), centres)


def test_the_positions_of_a_frozen_receiver_are_not_used(tmp_path: Path):
    places = in_world(orbit(9))
    frozen = places | dict.fromkeys(["06", "07", "08"], places["05"])
    usable, warnings = usable_priors(priors(frozen), tmp_path / "unread.db")
    assert sorted(usable.by_name) == ["00", "01", "02", "03", "04"]
    assert warnings == (Finding.of(FindingCode.FROZEN_POSITIONS, frozen=4, of=9, others=2),)
    twice = priors(places | {"06": places["05"]})
    assert usable_priors(twice, tmp_path / "unread.db") == (twice, ())
