"""Replay worlds: a model around a vehicle's home, and photographs in it."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from fvs_client import Candidate

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera, RigidTransform, SimilarityTransform, look_at
from fvs_engine.geometry.geodetic import GeodeticPosition, camera_at, enu_from_geodetic
from fvs_engine.lab.simulate.camera import GAMMA
from fvs_engine.lab.simulate.replay import ReplayPlace, ReplayScenery, open_replay, write_poses
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.render import render_color
from fvs_engine.views import PinholeView

CAMERA = PinholeCamera(48, 36, 40.0, 40.0, 24.0, 18.0)
HOME = GeodeticPosition(47.0, 8.0, 400.0)
PLACE = ReplayPlace(distance_m=25.0, lowest_m=7.0)
MODEL_FROM_MADE = SimilarityTransform(
    0.3, camera_at(np.zeros(3), 40.0, 20.0, 30.0).rotation, np.array([5.0, -2.0, 1.0])
)
"""A model's frame is any frame."""


def gaussians() -> Gaussians:
    generator = torch.Generator().manual_seed(0)
    means = torch.randn((80, 3), generator=generator).numpy().astype(np.float64)
    return Gaussians(
        means=torch.from_numpy(MODEL_FROM_MADE.apply(means)).float(),
        log_scales=torch.full((80, 3), -2.5),
        quaternions_wxyz=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(80, 1),
        opacity_logits=torch.full((80,), 3.0),
        sh_dc=torch.randn((80, 3), generator=generator),
        sh_rest=torch.zeros((80, 0, 3)),
    )


def views(count: int = 12) -> list[PinholeView]:
    """A ring of cameras around z that look at (0, 0, 0.5)."""
    found = []
    for number in range(count):
        angle = 2.0 * np.pi * number / count
        centre = [6.0 * np.cos(angle), 6.0 * np.sin(angle), 2.0 + 0.5 * np.sin(3.0 * angle)]
        camera = MODEL_FROM_MADE.move_camera(look_at(centre, [0.0, 0.0, 0.5], [0.0, 0.0, 1.0]))
        found.append(PinholeView(f"{number}.jpg", CAMERA, camera.inverse()))
    return found


def test_the_cameras_are_around_home_where_they_were_put() -> None:
    scenery = ReplayScenery(gaussians(), views(), CAMERA, PLACE)
    centres = np.stack([view.centre for view in scenery.views])
    assert np.hypot(*centres[:, :2].T) == pytest.approx(25.0)
    assert centres[:, 2].min() == pytest.approx(7.0)
    assert np.ptp(centres[:, 2]) == pytest.approx(1.0 / 6.0 * 25.0, rel=0.1)
    assert scenery.target_height_m == pytest.approx(7.0 - 1.0 / 6.0 * 25.0, abs=0.1)  # from 1.5 to 0.5, of 6
    looked_at = [view.camera_from_model.apply(np.zeros(3)) for view in scenery.views]
    assert all(x == pytest.approx(0.0, abs=1e-6) and z > 0 for x, _, z in looked_at)  # home is below it


def test_a_photograph_from_there_is_the_models_own_view() -> None:
    scenery = ReplayScenery(gaussians(), views(), CAMERA, PLACE)
    for view, placed in zip(views(3), ReplayScenery(gaussians(), views(3), CAMERA, PLACE).views, strict=True):
        assert view.name == placed.name
    rasterizer = create_rasterizer("auto")
    for view, placed in zip(views(), scenery.views, strict=True):
        expected = render_color(gaussians(), view, rasterizer)
        assert expected.std() > 0.05
        light = scenery.light(placed.camera_from_model.inverse())
        assert light ** (1.0 / GAMMA) == pytest.approx(expected, abs=2e-3)


def test_cameras_that_look_down_are_put_over_home() -> None:
    down = [
        PinholeView(
            f"{x}-{y}",
            CAMERA,
            MODEL_FROM_MADE.move_camera(look_at([x, y, 9.0], [x, y, 0.0], [0.0, 1.0, 0.0])).inverse(),
        )
        for x in (-1.0, 0.0, 1.0)
        for y in (-1.0, 1.0)
    ]
    with pytest.raises(InvalidInputError, match="no common up"):
        ReplayScenery(gaussians(), [*down, *map(_turned, down)], CAMERA, PLACE)
    centres = np.stack([view.centre for view in ReplayScenery(gaussians(), down, CAMERA, PLACE).views])
    assert np.median(np.hypot(*centres[:, :2].T)) == pytest.approx(25.0)
    assert centres.mean(axis=0)[:2] == pytest.approx([0.0, 0.0], abs=1e-6)


def _turned(view: PinholeView) -> PinholeView:
    """The same camera, upside down."""
    turn = RigidTransform(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    return PinholeView(f"{view.name}-turned", view.camera, turn @ view.camera_from_model)


def test_poses_are_candidates_of_the_client(tmp_path: Path) -> None:
    scenery = ReplayScenery(gaussians(), views(), CAMERA, PLACE)
    write_poses(tmp_path / "poses.json", scenery.views, HOME)
    read = [Candidate.model_validate(entry) for entry in json.loads((tmp_path / "poses.json").read_text())]
    assert [candidate.id for candidate in read] == [view.name for view in scenery.views]
    for candidate, view in zip(read, scenery.views, strict=True):
        pose = candidate.pose.model_dump()
        position = GeodeticPosition(pose["latitude_deg"], pose["longitude_deg"], pose["altitude_m"])
        found = camera_at(
            enu_from_geodetic(position, HOME), pose["yaw_deg"], pose["pitch_deg"], pose["roll_deg"]
        )
        assert found.matrix == pytest.approx(view.camera_from_model.inverse().matrix, abs=1e-5)


def test_what_cannot_be_replayed_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="3 photographs"):
        ReplayScenery(gaussians(), views(2), CAMERA, PLACE)
    still = views()[:1] * 3
    with pytest.raises(InvalidInputError, match="one place"):
        ReplayScenery(gaussians(), still, CAMERA, PLACE)
    with pytest.raises(InvalidInputError, match="above ground"):
        ReplayPlace(distance_m=0.0)
    with pytest.raises(InvalidInputError):
        open_replay(tmp_path)
