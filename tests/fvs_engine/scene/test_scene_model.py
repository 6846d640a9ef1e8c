"""A model without a scene: what it makes of candidates."""

import numpy as np
import pytest
import torch

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.lab.baselines import create_selector
from fvs_engine.plan.tours import Budget
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.ply import read_ply
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.views import PinholeView
from fvs_schema.candidates import CandidateStatus

CAMERA = PinholeCamera(32, 24, 30, 30, 16, 12)


def on_ring(name: str, angle_deg: float) -> PinholeView:
    angle = np.deg2rad(angle_deg)
    pose = look_at([4.0 * np.cos(angle), 4.0 * np.sin(angle), 1.0], [0, 0, 0], [0, 0, 1])
    return PinholeView(name, CAMERA, pose.inverse())


INSIDE = PinholeView("inside", CAMERA, look_at([0.5, 0.0, 0.0], [0, 0, 0], [0, 0, 1]).inverse())


@pytest.fixture
def model() -> SceneModel:
    """One Gaussian, a ball of radius 1 at the origin; of three photographs the middle one is held out."""
    none = torch.zeros((1, 3))
    return SceneModel(
        gaussians=Gaussians(none, none, torch.ones((1, 4)), torch.zeros(1), none + 1, torch.zeros((1, 0, 3))),
        sh_degree=0,
        iterations=1,
        views=(on_ring("1.jpg", 0.0), on_ring("3.jpg", 40.0)),
        held_out=(on_ring("2.jpg", 20.0),),
    )


def test_a_plan_serves_all_views_and_the_candidates_where_a_camera_can_be(model: SceneModel) -> None:
    candidates = [INSIDE, on_ring("a", 60.0), on_ring("b", 80.0)]
    start, space = np.array([4.0, 0.0, 1.0]), model.space(safety=0.01)
    plan = model.plan(candidates, Budget(2), [start], lambda _spread: [], space=space)
    assert plan.targets == ("1.jpg", "2.jpg", "3.jpg", "a", "b")
    assert len(plan.target_variances) == 5
    assert [warning.code for warning in plan.warnings] == ["too-close"]
    assert {term.name for term in plan.terms} == {"a", "b"}
    gate = (on_ring("gate", 90.0),)
    wanted = model.plan(candidates, Budget(1), [start], lambda _spread: [], targets=gate, space=space)
    assert wanted.targets == ("gate",)


def test_a_candidate_may_be_called_as_a_photograph_is(model: SceneModel) -> None:
    candidates = [INSIDE, on_ring("1.jpg", 60.0)]
    selector, rasterizer = create_selector("farthest"), create_rasterizer("reference")
    found = model.rank(candidates, selector, rasterizer, space=model.space(safety=0.01))
    assert [(one.name, one.rank, one.status) for one in found.candidates] == [
        ("1.jpg", 1, CandidateStatus.RANKED),
        ("inside", None, CandidateStatus.IN_MATTER),
    ]


def test_what_is_exported_is_read_again(model: SceneModel, tmp_path) -> None:
    model.export(tmp_path / "model.ply")
    assert len(read_ply(tmp_path / "model.ply")) == 1
    assert (tmp_path / "model.spz").stat().st_size > 0


def test_a_spectrum_is_shown_in_shares_of_its_range(model: SceneModel) -> None:
    found = model.spectrum(model.views[0], create_rasterizer("reference"))
    assert found.shape == (24, 32)
    assert (found.min(), found.max()) == (0.0, 1.0)
    assert found.argmax() == 12 * 32 + 16  # 0 cycles/px
