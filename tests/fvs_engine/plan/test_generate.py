"""Candidates in volumes: clear, aimed at the model and named for good."""

import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera
from fvs_engine.plan.clearance import FreeSpace, Matter
from fvs_engine.plan.generate import MOST_CANDIDATES, Aim, candidates_in
from fvs_engine.plan.volumes import Box, Corridor, Cylinder, Prism, Shell

CAMERA = PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0)
UP = np.array([0.0, 0.0, 1.0])


def a_house():
    """The surface of a cube from −1 to 1."""
    points = np.random.default_rng(0).uniform(-1.0, 1.0, size=(3000, 3))
    side = np.argmax(np.abs(points), axis=1)
    points[np.arange(3000), side] = np.sign(points[np.arange(3000), side])
    return Matter(points, np.full(3000, 0.05))


HOUSE = a_house()
VOLUMES = [
    Box(centre=(0.0, 0.0, 1.0), size=(8.0, 8.0, 4.0)),
    Cylinder(base=(0.0, 0.0, -1.0), radius=4.0, height=4.0),
    Prism(corners=((-4.0, -4.0, 0.0), (4.0, -4.0, 0.0), (0.0, 5.0, 0.0)), lower=-1.0, upper=3.0),
    Shell(centre=(0.0, 0.0, 0.0), inner=2.0, outer=4.0, above=-0.5),
    Corridor(path=((-4.0, -3.0, 0.0), (4.0, -3.0, 1.0)), radius=1.0),
]
each = pytest.mark.parametrize("volume", VOLUMES, ids=lambda volume: volume.kind)


def directions(views):
    return np.array([view.camera_from_model.rotation[2] for view in views])


def centres(views):
    return np.array([view.centre for view in views])


@each
@pytest.mark.parametrize("target", ["middle", "nearest", (0.5, 0.0, 0.0)])
@pytest.mark.parametrize("level", [False, True])
def test_candidates_are_clear_inside_and_aimed_at_the_model(volume, target, level):
    zone = Cylinder(base=(2.5, -2.5, -5.0), radius=0.7, height=20.0)
    space = FreeSpace(HOUSE, 0.3, [zone], start=np.zeros(3), reach=4.5)
    views = candidates_in(volume, 20, CAMERA, up=UP, aim=Aim(target, level), space=space)
    assert len(views) == 20
    places = centres(views)
    assert volume.contains(places).all()
    assert HOUSE.clear(places, 0.3 - 1e-9).all()
    assert not zone.contains(places).any()
    assert (np.linalg.norm(places, axis=1) <= 4.5).all()
    aims = {"middle": HOUSE.middle, "nearest": HOUSE.nearest(places)}.get(target, target)
    wanted = np.asarray(aims) - places
    if level:
        wanted = wanted * [1.0, 1.0, 0.0]
        assert directions(views)[:, 2] == pytest.approx(0.0)
    wanted = wanted / np.linalg.norm(wanted, axis=1, keepdims=True)
    assert np.einsum("ni,ni->n", directions(views), wanted) == pytest.approx(1.0)
    for view in views:  # upright, and nothing is aimed into the void
        assert view.camera_from_model.rotation[1] @ UP <= 1e-9
        pixels = CAMERA.project(
            HOUSE.centres @ view.camera_from_model.rotation.T + view.camera_from_model.translation
        )
        assert ((pixels >= 0) & (pixels <= [640, 480])).all(axis=1).any()


def test_level_views_over_the_model_are_left_out():
    high = Box(centre=(0.0, 0.0, 12.0), size=(4.0, 4.0, 1.0))
    space = FreeSpace(HOUSE)
    assert candidates_in(high, 10, CAMERA, up=UP, space=space)
    with pytest.raises(InvalidInputError, match="in its frame") as caught:
        candidates_in(high, 10, CAMERA, up=UP, aim=Aim(level=True), space=space)
    assert caught.value.hint


@pytest.mark.parametrize("size", [400.0, 1e9])
def test_from_so_far_that_the_model_is_a_dot_nothing_is_photographed(size):
    """A volume in millimetres, for a model in metres."""
    box = Box(centre=(0.0, 0.0, 0.0), size=(size, size, size))
    near = Box(centre=(0.0, 0.0, 0.0), size=(20.0, 20.0, 20.0))
    assert len(candidates_in(near, 50, CAMERA, up=UP, space=FreeSpace(HOUSE))) == 50
    if size < 1e3:
        some = candidates_in(box, 50, CAMERA, up=UP, space=FreeSpace(HOUSE))
        assert np.linalg.norm(centres(some), axis=1).max() < 40.0
    else:
        with pytest.raises(InvalidInputError, match="large enough") as caught:
            candidates_in(box, 50, CAMERA, up=UP, space=FreeSpace(HOUSE))
        assert "nearer" in caught.value.hint


def test_names_stay_when_more_are_asked_for_or_the_model_changes():
    few = candidates_in(VOLUMES[0], 20, CAMERA, up=UP, space=FreeSpace(HOUSE, 0.2))
    many = candidates_in(VOLUMES[0], 50, CAMERA, up=UP, space=FreeSpace(HOUSE, 0.2))
    assert [view.name for view in few] == [view.name for view in many[:20]]
    assert len({view.name for view in many}) == 50
    assert all(view.name.startswith("box-") for view in many)
    grown = candidates_in(VOLUMES[0], 50, CAMERA, up=UP, space=FreeSpace(HOUSE, 0.6))
    known = {view.name: view.centre for view in many}
    shared = [view for view in grown if view.name in known]
    assert 0 < len(shared) < 50
    assert all(np.array_equal(view.centre, known[view.name]) for view in shared)
    assert candidates_in(VOLUMES[0], 1, CAMERA, up=UP, space=FreeSpace(HOUSE), prefix="roof")[
        0
    ].name.startswith("roof-")


def test_candidates_turn_with_the_frame():
    """With another up and the model turned alike, the viewing directions are level to that up."""
    up = np.array([0.0, 1.0, 0.0])
    turned = Matter(HOUSE.centres[:, [0, 2, 1]], HOUSE.radii)
    shell = Shell(up=(0.0, 1.0, 0.0), centre=(0.0, 0.0, 0.0), inner=2.0, outer=4.0, above=0.0)
    views = candidates_in(shell, 30, CAMERA, up=up, aim=Aim(level=True), space=FreeSpace(turned, 0.1))
    assert directions(views) @ up == pytest.approx(0.0)
    assert (centres(views)[:, 1] >= 0.0).all()


def test_without_matter_a_target_is_needed():
    with pytest.raises(InvalidInputError, match="no solid part"):
        candidates_in(VOLUMES[0], 5, CAMERA, up=UP)
    assert len(candidates_in(VOLUMES[0], 5, CAMERA, up=UP, aim=Aim((0.0, 0.0, 0.0)))) == 5


@pytest.mark.parametrize(
    ("volume", "space", "message"),
    [
        (
            Box(centre=(0, 0, 0), size=(0.1, 0.1, 0.1)),
            FreeSpace(HOUSE, 2.0),
            "inside a solid part of the model, or within the safety",
        ),
        (VOLUMES[0], FreeSpace(HOUSE, no_fly=[Box(centre=(0, 0, 0), size=(99, 99, 99))]), "zones cover"),
        (VOLUMES[0], FreeSpace(HOUSE, start=np.full(3, 50.0), reach=1.0), "out of reach"),
    ],
)
def test_where_nothing_is_left_it_is_said_why(volume, space, message):
    with pytest.raises(InvalidInputError, match=message) as caught:
        candidates_in(volume, 5, CAMERA, up=UP, space=space)
    assert caught.value.hint


@pytest.mark.parametrize("count", [0, -1, MOST_CANDIDATES + 1])
def test_counts_are_limited(count):
    with pytest.raises(InvalidInputError, match="100,000"):
        candidates_in(VOLUMES[0], count, CAMERA, up=UP, space=FreeSpace(HOUSE))


def test_what_is_no_aim_is_refused():
    for aim in (Aim("everything"), Aim((np.nan, 0.0, 0.0))):
        with pytest.raises(InvalidInputError):
            candidates_in(VOLUMES[0], 5, CAMERA, up=UP, aim=aim, space=FreeSpace(HOUSE))
    with pytest.raises(InvalidInputError, match="zero"):
        candidates_in(VOLUMES[0], 5, CAMERA, up=(0, 0, 0), space=FreeSpace(HOUSE))


def test_fewer_are_returned_where_little_is_free():
    """A slit between the house and a zone."""
    zone = Box(centre=(0.0, 0.0, 1.0), size=(8.0, 8.0, 3.999))
    views = candidates_in(
        VOLUMES[0], 2_000, CAMERA, up=UP, aim=Aim((0.0, 0.0, 0.0)), space=FreeSpace(HOUSE, no_fly=[zone])
    )
    assert 0 < len(views) < 2_000
