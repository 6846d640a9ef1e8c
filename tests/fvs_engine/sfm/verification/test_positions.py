import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import SimilarityTransform
from fvs_engine.sfm.verification.positions import Positions

WORLD_FROM_MODEL = SimilarityTransform(
    3.0, Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([5.0, -2.0, 9.0])
)

Places = dict[str, np.ndarray]


def orbit(count: int, radius: float = 10.0) -> Places:
    angles = np.linspace(0.0, 2.0, count)
    return {f"{k:02}": radius * np.array([np.cos(a), np.sin(a), 0.1 * k]) for k, a in enumerate(angles)}


def in_world(centres: Places) -> Places:
    return {name: WORLD_FROM_MODEL.apply(centre) for name, centre in centres.items()}


@given(st.integers(6, 30), st.integers(0, 29))
def test_a_camera_elsewhere_is_accused_and_no_other(count: int, which: int):
    centres = orbit(count)
    places = in_world(centres)
    assert Positions(places).misplaced(centres) == {}
    accused = f"{which % count:02}"
    away = places | {accused: places[accused] + np.array([0.0, 0.0, 40.0])}
    found = Positions(away).misplaced(centres)
    assert found == {accused: pytest.approx(40.0)}


def test_noise_accuses_nobody_and_hides_no_blunder():
    centres = orbit(20)
    noise = np.random.default_rng(0).normal(scale=1.0, size=(20, 3))
    places = {
        name: place + error for (name, place), error in zip(in_world(centres).items(), noise, strict=True)
    }
    assert Positions(places).misplaced(centres) == {}
    places["07"] = places["07"] + np.array([0.0, 0.0, 25.0])
    assert set(Positions(places).misplaced(centres)) == {"07"}


def test_a_few_positions_and_inaccurate_ones_say_nothing():
    centres = orbit(20)
    away = in_world(centres) | {"03": np.array([500.0, 0.0, 0.0])}
    few = {name: away[name] for name in ("00", "01", "02", "03", "04")}
    assert Positions(few).misplaced(centres) == {}
    assert Positions(away, accuracy=5.0).misplaced(centres) == {}  # the orbit is 20 wide
    assert Positions(away, accuracy=5.0).residual_share(centres) is None
    assert set(Positions(away, accuracy=1.0).misplaced(centres)) == {"03"}
    assert Positions().misplaced(centres) == {}


def test_the_residual_tells_a_wrong_model_from_a_right_one():
    centres = orbit(20)
    positions = Positions(in_world(centres))
    assert positions.residual_share(centres) == pytest.approx(0.0, abs=1e-9)
    order = np.random.default_rng(0).permutation(20)
    share = positions.residual_share(
        {name: list(centres.values())[order[k]] for k, name in enumerate(centres)}
    )
    assert share is not None
    assert share > 0.25


def test_what_another_process_makes_of_them_is_the_same():
    positions = Positions(in_world(orbit(3)), accuracy=2.5)
    again = Positions.from_json(positions.to_json())
    assert again.accuracy == 2.5
    assert {name: place.tolist() for name, place in again.by_name.items()} == {
        name: place.tolist() for name, place in positions.by_name.items()
    }
