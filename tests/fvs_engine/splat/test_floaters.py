"""Floaters among the Gaussians of a ring of views: near a camera, and shown by one photograph alone."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
from floating import with_one_before
from random_gaussians import random_gaussians

from fvs_engine.geometry import RigidTransform
from fvs_engine.images.masks import Mask
from fvs_engine.monitor import Monitor
from fvs_engine.splat.floaters import blending_weights, find_floaters, without_floaters
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import PinholeView
from fvs_schema.findings import Finding, FindingCode, Severity

MATTER = random_gaussians(150, 0, seed=5)
POINTS = MATTER.means.numpy().astype(np.float64)


def _neighbour(view: TrainingView) -> TrainingView:
    """A view 5 cm to its right."""
    pose = view.camera_from_model
    moved = RigidTransform(pose.rotation, pose.translation - [0.05, 0.0, 0.0])
    return replace(view, name="neighbour.png", camera_from_model=moved)


def _is_floater(
    gaussians: Gaussians,
    views: Sequence[PinholeView],
    points: np.ndarray = POINTS,
    masks: dict[str, Mask] | None = None,
) -> bool:
    """Whether the last Gaussian is a floater; none of the others may be."""
    rasterizer = create_rasterizer("cpu")
    floaters = find_floaters(gaussians, views, points, rasterizer, Monitor(), masks)
    assert not floaters[:-1].any()
    return bool(floaters[-1])


@pytest.mark.parametrize(
    ("depth", "floats"),
    [(0.8, True), (2.4, False), (-0.5, True)],
    ids=["before the camera", "at the points", "where no photograph looks"],
)
def test_what_is_near_a_camera_is_a_floater(
    scene_views: tuple[TrainingView, ...], depth: float, floats: bool
) -> None:
    assert _is_floater(with_one_before(scene_views[0], depth, MATTER), scene_views) == floats


def test_what_two_photographs_show_is_none(scene_views: tuple[TrainingView, ...]) -> None:
    """Unless a mask says that it does not count in the second one."""
    views = (*scene_views, _neighbour(scene_views[0]))
    gaussians = with_one_before(scene_views[0], 0.8, MATTER)
    assert not _is_floater(gaussians, views)
    nothing = np.zeros((40, 48), dtype=bool)
    assert _is_floater(gaussians, views, masks={"neighbour.png": nothing})


def test_without_points_nothing_is_a_floater(scene_views: tuple[TrainingView, ...]) -> None:
    gaussians = with_one_before(scene_views[0], 0.8, MATTER)
    assert not _is_floater(gaussians, scene_views, points=np.zeros((0, 3)))


def test_the_weights_are_those_of_the_blending(
    scene_views: tuple[TrainingView, ...], make_gaussians: Callable[..., Gaussians]
) -> None:
    """What all Gaussians weigh together is the alpha of the render."""
    view, rasterizer, gaussians = scene_views[2], create_rasterizer("cpu"), make_gaussians(60, 2)
    alpha = rasterizer.render(gaussians, view.camera, view.camera_from_model).alpha
    weights = blending_weights(gaussians, view, rasterizer)
    assert weights.min() >= 0
    assert float(weights.sum()) == pytest.approx(float(alpha.sum()), rel=1e-4)
    left = np.arange(48)[None].repeat(40, 0) < 24
    half = blending_weights(gaussians, view, rasterizer, left)
    assert float(half.sum()) == pytest.approx(float(alpha[:, :24].sum()), rel=1e-4)


def test_a_note_says_how_many_were_left_out(scene_views: tuple[TrainingView, ...]) -> None:
    found: list[Finding] = []
    monitor = Monitor(on_warning=found.append)
    gaussians = with_one_before(scene_views[0], 0.8, MATTER)
    kept = without_floaters(gaussians, scene_views, POINTS, create_rasterizer("cpu"), monitor)
    assert [(each.code, each.severity) for each in found] == [(FindingCode.FLOATERS_REMOVED, Severity.NOTE)]
    assert found[0].numbers == {"floaters": 1, "of": 151}
    for name, tensor in kept.tensors().items():
        assert torch.equal(tensor, MATTER.tensors()[name])
    found.clear()
    assert without_floaters(kept, scene_views, POINTS, create_rasterizer("cpu"), monitor) is kept
    assert not found
