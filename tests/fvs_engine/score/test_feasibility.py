"""Which candidates can be photographed and registered: a wall, photographed from a distance of 4."""

import numpy as np
import pytest
import torch

from fvs_engine.candidates import RankedCandidate
from fvs_engine.geometry import PinholeCamera, RigidTransform, look_at
from fvs_engine.plan.clearance import FreeSpace
from fvs_engine.plan.familiarity import Observations
from fvs_engine.plan.volumes import Box
from fvs_engine.score.feasibility import Assessment, FeasibilityCheck, matter_of
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.views import PinholeView
from fvs_schema.candidates import CandidateStatus

CAMERA = PinholeCamera(64, 48, 60.0, 60.0, 32.0, 24.0)
EYES = [np.array([x, 0.0, -4.0]) for x in (-1.0, -0.5, 0.0, 0.5, 1.0)]


def towards(name: str, eye: object, target: object = (0.0, 0.0, 0.0)) -> PinholeView:
    camera = look_at(np.asarray(eye), np.asarray(target), [0.0, -1.0, 0.0])
    return PinholeView(name, CAMERA, camera.inverse())


@pytest.fixture(scope="module")
def wall() -> Gaussians:
    """Opaque Gaussians side by side in the plane z = 0."""
    x, y = np.meshgrid(np.arange(-4, 8.01, 0.1), np.arange(-3, 3.01, 0.1))
    means = torch.tensor(np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3), dtype=torch.float32)
    count = len(means)
    quaternions = torch.zeros(count, 4)
    quaternions[:, 0] = 1.0
    return Gaussians(
        means,
        torch.full((count, 3), float(np.log(0.06))),
        quaternions,
        torch.full((count,), 4.0),
        torch.rand((count, 3), generator=torch.Generator().manual_seed(0)),
        torch.zeros((count, 0, 3)),
    )


def photographs() -> list[PinholeView]:
    return [towards(str(number), eye, eye + np.array([0.0, 0.0, 4.0])) for number, eye in enumerate(EYES)]


def assessed(
    wall: Gaussians,
    *views: PinholeView,
    safety: float = 0.0,
    zones: tuple[Box, ...] = (),
    observations: Observations | None = None,
) -> Assessment:
    check = FeasibilityCheck(wall, photographs(), observations)
    return check.assess(views, FreeSpace(matter_of(wall), safety, zones))


def test_a_view_from_where_photographs_were_taken_is_feasible_from_much_nearer_it_is_not(
    wall: Gaussians,
) -> None:
    views = [towards(f"{z}", (0.2, 0.1, -z)) for z in (5.0, 4.0, 3.0, 2.5, 1.5, 1.0, 0.3)]
    found = assessed(wall, *views).against
    assert found == dict.fromkeys(["1.5", "1.0", "0.3"], CandidateStatus.TOO_CLOSE)


def test_a_camera_among_gaussians_is_in_matter(wall: Gaussians) -> None:
    assert assessed(wall, towards("in", (0.0, 0.0, -0.02), (0.0, 0.0, 1.0))).against == {
        "in": CandidateStatus.IN_MATTER
    }


def test_what_no_photograph_had_in_its_frame_is_too_close_from_anywhere(wall: Gaussians) -> None:
    """The end of the wall: beside all photographs."""
    assert assessed(wall, towards("end", (5.8, 0.0, -4.0), (5.8, 0.0, 0.0))).against == {
        "end": CandidateStatus.TOO_CLOSE
    }


def test_a_safety_distance_that_is_given_is_kept_in_any_case(wall: Gaussians) -> None:
    views = [towards("far", (0.0, 0.0, -4.5)), towards("near", (0.0, 0.0, -3.5))]
    assert assessed(wall, *views, safety=4.0).against == {"near": CandidateStatus.TOO_CLOSE}


def test_zones_and_empty_views_have_their_own_status(wall: Gaussians) -> None:
    zone = Box(centre=(0.0, 0.0, -4.0), size=(0.1, 0.1, 0.1), up=(0.0, -1.0, 0.0))
    views = [
        towards("zone", (0.0, 0.0, -4.0)),
        towards("beside", (0.2, 0.0, -4.0)),
        towards("away", (0.0, 0.0, -4.0), (0.0, 0.0, -9.0)),
    ]
    assert assessed(wall, *views[1:], zones=(zone,)).against == {"away": CandidateStatus.NO_FLY}
    assert assessed(wall, *views).against == {"away": CandidateStatus.OUT_OF_MODEL}
    assert assessed(wall, views[0], zones=(zone,)).against == {"zone": CandidateStatus.NO_FLY}


def test_a_view_from_behind_shares_nothing_with_the_images(wall: Gaussians) -> None:
    points = np.random.default_rng(0).uniform([-2, -1.5, 0], [2, 1.5, 0], (300, 3))
    observations = Observations(
        points, np.repeat(np.arange(300), len(EYES)), np.tile(np.stack(EYES), (300, 1))
    )
    views = [towards("front", (0.2, 0.0, -4.0)), towards("behind", (0.2, 0.0, 4.0))]
    found = assessed(wall, *views, observations=observations)
    assert found.against == {"behind": CandidateStatus.UNREGISTRABLE}
    assert found.chances["front"] > 0.9
    assert found.chances["behind"] < 0.1
    assert found.registrable == 1
    assert assessed(wall, *views).chances == {}  # poses are known


def test_points_that_are_hidden_do_not_count(wall: Gaussians) -> None:
    spots = np.random.default_rng(0).uniform([-1, -1, 0], [1, 1, 0], (300, 3))
    view = towards("front", (0.2, 0.0, -4.0))
    for behind, status in ((1.0, None), (3.0, CandidateStatus.UNREGISTRABLE)):
        observations = Observations(
            spots + np.array([0.0, 0.0, behind]),
            np.repeat(np.arange(300), len(EYES)),
            np.tile(np.stack(EYES), (300, 1)),
        )
        assert assessed(wall, view, observations=observations).against.get("front") == status


def test_what_is_not_feasible_follows_without_rank_and_keeps_its_status_with_one() -> None:
    assessment = Assessment(
        {"b": CandidateStatus.TOO_CLOSE, "c": CandidateStatus.IN_MATTER}, {"a": 0.8, "b": 0.4, "c": 0.1}, 1
    )
    ranked = [RankedCandidate(1, "a", -0.5, CandidateStatus.RANKED, 1.0)]
    found = assessment.complete(ranked, {"b": 2.0, "c": 1.0})
    assert [(one.name, one.rank, one.status, one.chance) for one in found] == [
        ("a", 1, "ranked", 0.8),
        ("c", None, "in-matter", 0.1),
        ("b", None, "too-close", 0.4),
    ]
    everything = [RankedCandidate(1, "b", -2.0, CandidateStatus.RANKED, 1.0), *ranked]
    assert [(one.name, one.rank, one.status) for one in assessment.complete(everything)][:2] == [
        ("b", 1, "too-close"),
        ("a", 1, "ranked"),
    ]


def test_a_model_without_gaussians_shows_nothing(wall: Gaussians) -> None:
    empty = Gaussians(**{name: tensor[:0] for name, tensor in wall.tensors().items()})
    check = FeasibilityCheck(empty, photographs(), None)
    found = check.assess([PinholeView("a", CAMERA, RigidTransform.identity())], FreeSpace(matter_of(empty)))
    assert found.against == {"a": CandidateStatus.OUT_OF_MODEL}
