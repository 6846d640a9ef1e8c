import numpy as np
import pytest
import torch

from fvs_engine.errors import InvalidInputError
from fvs_engine.lab.baselines.coverage import SEEN_PX, Coverage, directional_coverage
from fvs_engine.splat.floaters import blending_weights
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.views import TrainingView


@pytest.fixture(
    params=["cpu", *(pytest.param(name, marks=pytest.mark.cuda) for name in ("gsplat", "triton"))]
)
def rasterizer(request):
    return create_rasterizer(request.param)


def one_gaussian(*means) -> Gaussians:
    count = len(means)
    return Gaussians(
        means=torch.tensor(means, dtype=torch.float32),
        log_scales=torch.full((count, 3), -0.5),
        quaternions_wxyz=torch.tensor([[1.0, 0, 0, 0]] * count),
        opacity_logits=torch.full((count,), 4.0),
        sh_dc=torch.zeros(count, 3),
        sh_rest=torch.zeros(count, 0, 3),
    )


def scores(selector, here) -> dict[str, float]:
    return {score.name: score.score for score in selector.score(here)}


def test_one_gaussian_is_covered_by_the_cosine_of_its_nearest_direction(context, view_at, rasterizer):
    gaussians = one_gaussian((0.0, 0.0, 0.0)).to(rasterizer.device)
    visited = [view_at("x", (3, 0, 0)), view_at("y", (0, 3, 0))]
    a = np.radians(30)
    candidates = [
        view_at("again", (3, 0, 0.0)),
        view_at("between", (3 * np.cos(a), 3 * np.sin(a), 0)),
        view_at("across", (0, 0, 3.001), target=(0, 0.001, 0)),
        view_at("behind", (-3, 0, 0.0)),
    ]
    here = context(visited, candidates, gaussians=gaussians, rasterizer=rasterizer)
    for score in Coverage(min_coverage=0.0).score(here):
        expected = {"again": 1, "between": (1 + np.cos(a)) / 2, "across": 0.5, "behind": 0.5}[score.name]
        assert score.score == pytest.approx(expected * score.coverage, rel=1e-3)


def test_what_stands_behind_something_was_not_seen(view_at, rasterizer):
    gaussians = one_gaussian((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.6, 0.0, 0.0), (-3.0, 0.0, 0.0))
    gaussians.log_scales[:3] += 0.7  # three in front hide the last
    front = view_at("front", (4, 0, 0))
    hidden = blending_weights(gaussians.to(rasterizer.device), front, rasterizer)
    assert (hidden >= SEEN_PX).tolist()[1:] == [True, True, False]
    alone = Gaussians(**{name: tensor[3:] for name, tensor in gaussians.tensors().items()})
    (free,) = blending_weights(alone.to(rasterizer.device), front, rasterizer)
    alpha = rasterizer.render(alone.to(rasterizer.device), front.camera, front.camera_from_model).alpha
    assert float(free) == pytest.approx(float(alpha.sum()), rel=1e-4)


def test_what_is_masked_was_not_seen(view_at, context, rasterizer):
    gaussians = one_gaussian((0.0, -0.7, 0.0), (0.0, 0.7, 0.0)).to(rasterizer.device)
    gaussians.log_scales -= 1.0
    view, again = view_at("front", (4, 0, 0)), view_at("again", (4, 0, 0))
    camera = view.camera
    image = np.zeros((camera.height, camera.width, 3), np.uint8)
    for masked in (False, True):
        mask = np.tile(np.arange(camera.width) < camera.width // 2, (camera.height, 1)) if masked else None
        visited = TrainingView("front", camera, view.camera_from_model, image, mask)
        here = context([visited], [again], gaussians=gaussians, rasterizer=rasterizer)
        (score,) = Coverage(min_coverage=0.0).score(here)
        assert score.score == pytest.approx(score.coverage * (0.5 if masked else 1.0), rel=0.02)


def test_the_unseen_side_comes_first_and_colours_do_not_matter(ball, ring, context, rasterizer):
    ball = ball.to(rasterizer.device)
    visited, candidates = ring(0, 20, 340), ring(5, 60, 180)
    found = scores(Coverage(), context(visited, candidates, gaussians=ball, rasterizer=rasterizer))
    assert found["180"] < found["060"] < found["005"]
    ball.sh_dc = -ball.sh_dc
    again = scores(Coverage(), context(visited, candidates, gaussians=ball, rasterizer=rasterizer))
    assert again == pytest.approx(found, abs=1e-6)


def test_every_visit_covers_more(ring, context):
    cpu = create_rasterizer("cpu")
    visited, (candidate,) = ring(0, 90, 180, 270), ring(45)
    found = [Coverage().score(context(visited[:n], [candidate], rasterizer=cpu))[0].score for n in range(5)]
    assert found == sorted(found)
    assert found[0] == 0
    assert found[4] > found[1] > 0.3


def test_empty_pixels_are_a_term_of_their_own(ring, context):
    here = context(ring(0), ring(10), rasterizer=create_rasterizer("cpu"))
    (plain,), (filled,) = Coverage().score(here), Coverage(empty_coverage=0.5).score(here)
    assert filled.score - plain.score == pytest.approx(0.5 * (1 - plain.coverage))
    with pytest.raises(InvalidInputError):
        Coverage(empty_coverage=2)


def test_directional_coverage_is_brute_force():
    draw = torch.Generator().manual_seed(0)
    directions = torch.nn.functional.normalize(torch.randn(3, 7, generator=draw), dim=0)
    cameras = torch.nn.functional.normalize(torch.randn(4, 3, 7, generator=draw), dim=1)
    seen = torch.rand(4, 7, generator=draw) < 0.5
    seen[:, 0] = False
    seen_from = torch.cat([cameras * seen[:, None], -1.0 * ~seen[:, None]], dim=1)
    found = directional_coverage(seen_from, directions)
    for n in range(7):
        cosines = [float(cameras[c, :, n] @ directions[:, n]) for c in range(4) if seen[c, n]]
        assert float(found[n]) == pytest.approx((1 + max(cosines, default=-1)) / 2, abs=1e-6)
