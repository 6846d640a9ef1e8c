"""Volumes against their definitions, and segments through them against many points along each."""

import itertools
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import SimilarityTransform, matrix_from_quaternion
from fvs_engine.plan.volumes import Box, Corridor, Cylinder, Prism, Shell, volume_from_json
from fvs_schema.volumes import MOST_CORNERS

L_SHAPE = (
    (0.0, 0.0, 9.0),
    (4.0, 0.0, 0.0),
    (4.0, 1.0, 0.0),
    (1.0, 1.0, 0.0),
    (1.0, 3.0, 0.0),
    (0.0, 3.0, 0.0),
)
BOX = Box(centre=(1.0, 2.0, 3.0), size=(2.0, 1.0, 3.0), along=(1.0, 1.0, 0.5))
CYLINDER = Cylinder(base=(0.0, 1.0, -1.0), radius=1.5, height=2.0)
PRISM = Prism(corners=L_SHAPE, lower=-1.0, upper=1.5)
SHELL = Shell(centre=(0.0, 1.0, 0.0), inner=1.0, outer=2.0, above=0.3)
CORRIDOR = Corridor(path=((0.0, 0.0, 0.0), (3.0, 0.0, 1.0), (3.0, 3.0, 1.0), (3.0, 3.0, 1.0)), radius=0.5)
VOLUMES = [BOX, CYLINDER, PRISM, SHELL, CORRIDOR]
SIZES = {
    "box": 6.0,
    "cylinder": np.pi * 1.5**2 * 2.0,
    "prism": 6.0 * 2.5,
    # Caps of height 2 − 0.3 and 1 − 0.3: the one less the other.
    "shell": np.pi * 1.7**2 * (2.0 - 1.7 / 3) - np.pi * 0.7**2 * (1.0 - 0.7 / 3),
}

each = pytest.mark.parametrize("volume", VOLUMES, ids=lambda volume: volume.kind)


def around(seed, count=1500):
    return np.random.default_rng(seed).uniform(-4.0, 6.0, size=(count, 3))


def by_definition(volume, points):
    x, y, z = points.T
    match volume.kind:
        case "box":
            along, over = (
                (points - BOX.centre) @ (np.array([1.0, 1.0]) / np.sqrt(2.0) @ np.eye(2, 3)),
                z - 3.0,
            )
            across = ((points - BOX.centre) @ np.array([-1.0, 1.0, 0.0])) / np.sqrt(2.0)
            return (np.abs(along) <= 1.0) & (np.abs(across) <= 0.5) & (np.abs(over) <= 1.5)
        case "cylinder":
            return (x**2 + (y - 1.0) ** 2 <= 1.5**2) & (z >= -1.0) & (z <= 1.0)
        case "prism":
            level = (x >= 0) & (y >= 0) & (((x <= 4) & (y <= 1)) | ((x <= 1) & (y <= 3)))
            return level & (z >= -1.0) & (z <= 1.5)
        case "shell":
            distance = np.sqrt(x**2 + (y - 1.0) ** 2 + z**2)
            return (distance >= 1.0) & (distance <= 2.0) & (z >= 0.3)
    path = np.array(CORRIDOR.path)
    line = np.concatenate(
        [a + np.linspace(0, 1, 2001)[:, None] * (b - a) for a, b in itertools.pairwise(path)]
    )
    near = np.array([np.linalg.norm(line - point, axis=1).min() for point in points])
    return near <= 0.5


@each
def test_a_volume_contains_what_it_says(volume):
    points = around(0)
    mask = volume.contains(points)
    assert 0 < mask.sum() < len(points)
    assert np.array_equal(mask, by_definition(volume, points))


@each
def test_segments_cross_a_volume_where_a_point_of_them_is_inside(volume):
    starts, ends = around(1), around(2)
    shares = np.linspace(0.0, 1.0, 501)
    inside = np.zeros(len(starts), dtype=bool)
    for share in shares:
        inside |= volume.contains(starts + share * (ends - starts))
    crossed = volume.crossed(starts, ends)
    assert not (inside & ~crossed).any()
    # What brute force misses is a short cut through an edge: refine there.
    for number in np.flatnonzero(crossed & ~inside):
        fine = starts[number] + np.linspace(0, 1, 400_001)[:, None] * (ends[number] - starts[number])
        assert volume.contains(fine).any()


@each
def test_segments_of_no_length_cross_where_they_are(volume):
    points = around(3)
    assert np.array_equal(volume.crossed(points, points), volume.contains(points))


@each
def test_positions_are_inside_even_and_the_same_when_more_are_asked_for(volume):
    positions = volume.sample(3000)
    assert positions.shape == (3000, 3)
    assert volume.contains(positions).all()
    assert np.array_equal(volume.sample(700), positions[:700])
    assert len(np.unique(positions, axis=0)) == 3000
    # Every region gets its share, far more evenly than by chance (σ of a share p by chance: √(p(1−p)/n)).
    everywhere = np.random.default_rng(4).uniform(-3.0, 6.0, size=(400_000, 3))
    everywhere = everywhere[volume.contains(everywhere)]
    middle = everywhere.mean(axis=0)
    for direction in np.random.default_rng(5).normal(size=(20, 3)):
        expected = ((everywhere - middle) @ direction > 0).mean()
        chance = np.sqrt(0.25 / len(everywhere)) + 0.5 * np.sqrt(0.25 / 3000)
        assert ((positions - middle) @ direction > 0).mean() == pytest.approx(expected, abs=3 * chance)


@pytest.mark.parametrize("volume", VOLUMES[:4], ids=lambda volume: volume.kind)
def test_volumes_have_their_size(volume):
    points = np.random.default_rng(6).uniform(-4.0, 6.0, size=(400_000, 3))
    share = SIZES[volume.kind] / 1000.0
    chance = np.sqrt(share / len(points))
    assert volume.contains(points).mean() == pytest.approx(share, abs=5 * chance)


@each
@given(
    quaternion=st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    scale=st.floats(0.01, 100.0),
    seed=st.integers(0, 1000),
)
def test_a_moved_volume_contains_the_moved_points(volume, quaternion, scale, seed):
    moved_from = SimilarityTransform(scale, matrix_from_quaternion(np.array(quaternion)), [3.0, -2.0, 5.0])
    moved = volume.moved(moved_from)
    assert moved.kind == volume.kind
    points, others = around(seed, 200), around(seed + 1, 200)
    assert np.array_equal(moved.contains(moved_from.apply(points)), volume.contains(points))
    assert np.array_equal(
        moved.crossed(moved_from.apply(points), moved_from.apply(others)), volume.crossed(points, others)
    )


@each
def test_volumes_survive_json(volume):
    assert volume_from_json(volume.model_dump_json()) == volume


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"kind": "box", "centre": [0, 0, 0], "size": [1, 0, 1]}', "box.size.1"),
        ('{"kind": "box", "centre": [1e9, 0, 0], "size": [1e-5, 1, 1]}', "no extent"),
        ('{"kind": "box", "centre": [0, 0, 0], "size": [1, 1, 1], "along": [0, 0, 2]}', "cannot point up"),
        ('{"kind": "box", "centre": ["0", 0, 0], "size": [1, 1, 1]}', "box.centre.0"),
        ('{"kind": "cylinder", "base": [0, 0, 0], "radius": 1, "height": -1}', "cylinder.height"),
        ('{"kind": "shell", "centre": [0, 0, 0], "inner": 2, "outer": 2}', "thickness"),
        ('{"kind": "shell", "centre": [0, 0, 0], "inner": 1, "outer": 2, "above": 2}', "is above 2"),
        ('{"kind": "corridor", "path": [[0, 0, 0]], "radius": 1}', "corridor.path"),
        ('{"kind": "cylinder", "up": [0, 0, 0], "base": [0, 0, 0], "radius": 1, "height": 1}', "up vector"),
        ('{"kind": "prism", "corners": [[0,0,0],[1,0,0],[0,1,0]], "lower": 2, "upper": 2}', "needs a height"),
        (
            '{"kind": "prism", "corners": [[0,0,0],[1,1,0],[1,0,0],[0,1,0]], "lower": 0, "upper": 1}',
            "crosses",
        ),
        ('{"kind": "prism", "corners": [[0,0,0],[1,0,0],[2,0,5]], "lower": 0, "upper": 1}', "polygon"),
        (
            '{"kind": "prism", "corners": [[0,0,0],[0,0,7],[1,0,0],[0,1,0]], "lower": 0, "upper": 1}',
            "the same",
        ),
        ('{"kind": "sphere"}', "one of 'box', .*'corridor'\\."),
        ("not json", "JSON"),
    ],
)
def test_what_is_no_volume_is_said_plainly(text, message):
    with pytest.raises(InvalidInputError, match=message) as caught:
        volume_from_json(text)
    assert caught.value.hint


def test_corners_are_limited():
    with pytest.raises(ValueError, match="at most 200 items"):
        Corridor(path=((0.0, 0.0, 0.0),) * 201, radius=1.0)


@pytest.mark.parametrize("kind", ["prism", "corridor"])
def test_legs_past_a_volume_with_many_corners_cost_little(kind):
    angles = np.linspace(0.0, 2.0 * np.pi, MOST_CORNERS, endpoint=False)
    radii = np.where(np.arange(MOST_CORNERS) % 2, 1.0, 0.5)
    star = [(r * np.cos(a), r * np.sin(a), 0.0) for r, a in zip(radii, angles, strict=True)]
    prism = Prism(corners=tuple(star), lower=-1.0, upper=1.0)
    volume = prism if kind == "prism" else Corridor(path=tuple(star), radius=0.1)
    draw = np.random.default_rng(0)
    starts = draw.uniform(-20.0, 20.0, size=(20_000, 3)) * (1.0, 1.0, 0.02)
    ends = starts + draw.normal(size=(20_000, 3)) * (1.0, 1.0, 0.02)
    begun = time.process_time()
    crossed = volume.crossed(starts, ends)
    assert time.process_time() - begun < 2.0
    assert 0 < crossed.sum() < 800
