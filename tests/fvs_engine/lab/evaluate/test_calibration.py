from pathlib import Path

import numpy as np
import pytest
from scipy.stats import spearmanr

from fvs_engine.images.pixels import load_rgb
from fvs_engine.lab.evaluate.calibration import calibrate, rank_correlation
from fvs_engine.lab.evaluate.held_out import evaluate
from fvs_engine.lab.evaluate.protocol import Protocol
from fvs_engine.lab.evaluate.run import Setup
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.score import CandidateScore
from fvs_engine.select.candidate_views import align
from fvs_engine.select.loop import SelectionLoop
from fvs_engine.splat.metrics import psnr
from fvs_engine.splat.raster import create_rasterizer
from fvs_schema.candidates import CandidateStatus

PSNR_DB = {"a": 10.0, "b": 15.0, "c": 20.0, "d": 25.0}
ALL = frozenset(PSNR_DB)


def scores(**values: float | None) -> list[CandidateScore]:
    return [
        CandidateScore(name, None, CandidateStatus.OUT_OF_MODEL, 0.0)
        if value is None
        else CandidateScore(name, value, CandidateStatus.RANKED, 1.0)
        for name, value in values.items()
    ]


def test_asking_first_for_the_worst_render_is_positive() -> None:
    worst_first = scores(a=1.0, b=2.0, c=3.0, d=40.0)  # the lowest score is asked for first
    assert rank_correlation("m", worst_first, PSNR_DB, ALL).all_candidates == pytest.approx(1.0)
    best_first = scores(a=4.0, b=3.0, c=2.0, d=-1.0)
    assert rank_correlation("m", best_first, PSNR_DB, ALL).all_candidates == pytest.approx(-1.0)


def test_a_mixed_order_by_hand() -> None:
    # ranks 1 3 2 4 against 1 2 3 4: 1 − 6·2 / (4·15)
    found = rank_correlation("m", scores(a=0.0, b=2.0, c=1.0, d=3.0), PSNR_DB, ALL)
    assert found.all_candidates == pytest.approx(0.8)
    assert found.in_reach is None  # all are in reach: it would be the same number


def test_candidates_without_a_score_are_counted_and_left_out() -> None:
    found = rank_correlation("m", scores(a=1.0, b=None, c=2.0, d=3.0), PSNR_DB, ALL)
    assert (found.candidates, found.scored) == (4, 3)
    assert found.all_candidates == pytest.approx(1.0)


def test_scores_that_cannot_be_compared_do_not_count() -> None:
    """A view that shows next to nothing scores lowest, and is asked for last all the same."""
    void = CandidateScore("d", -9.0, CandidateStatus.LOW_COVERAGE, 0.01)
    found = rank_correlation("m", [*scores(a=1.0, b=2.0, c=3.0), void], PSNR_DB, ALL)
    assert (found.candidates, found.scored) == (4, 3)
    assert found.all_candidates == pytest.approx(1.0)


@pytest.mark.parametrize("values", [{"a": 1.0, "b": 1.0, "c": 1.0}, {"a": 1.0, "b": 2.0}, {}])
def test_no_order_no_correlation(values: dict[str, float]) -> None:
    assert rank_correlation("m", scores(**values), PSNR_DB, ALL).all_candidates is None


def test_what_is_in_reach_is_judged_by_itself() -> None:
    found = rank_correlation("m", scores(a=3.0, b=2.0, c=1.0, d=9.0), PSNR_DB, frozenset("abc"))
    assert found.in_reach == pytest.approx(-1.0)
    assert found.all_candidates == pytest.approx(0.2)


@pytest.fixture
def loop(ring: Dataset, quick: Protocol, tmp_path: Path) -> SelectionLoop:
    setup = Setup(ring, quick, create_rasterizer("cpu"), None)
    loop = setup.open(tmp_path / "loop", "farthest", 0, Monitor())
    loop.begin(Monitor())
    return loop


def test_a_real_loop_is_asked_and_does_not_change(loop: SelectionLoop, ring: Dataset) -> None:
    before = {name: tensor.clone() for name, tensor in loop.model.gaussians.tensors().items()}
    found = calibrate(loop, ["median-frequency", "farthest"], Monitor())
    evaluate(loop, Monitor())
    assert loop.visited == loop.initial
    for name, tensor in loop.model.gaussians.tensors().items():
        assert tensor.equal(before[name])

    # the same by other means: render every unvisited view, and ask the selector for its scores
    from fvs_engine.lab.baselines import create_selector

    truths = []
    for name in loop.unvisited:
        view = ring.by_name[name]
        render = loop.scene.rasterizer.render(
            loop.model.gaussians, loop.scene.expected_camera(name), view.camera_from_model, sh_degree=0
        )
        photograph = load_rgb(ring.image_dir / name).astype(np.float64) / 255
        truths.append(psnr(render.color.detach().clamp(0, 1).numpy(), photograph))
    assert found.visited == 3
    for entry in found.selectors:
        said = create_selector(entry.method).score(loop.context(loop.unvisited, align(loop.scene)))
        expected = spearmanr([score.score for score in said], truths).statistic
        assert entry.all_candidates == pytest.approx(expected)
        assert (entry.candidates, entry.in_reach) == (len(truths), None)


def test_evaluation_measures_the_held_out_photographs(loop: SelectionLoop, ring: Dataset) -> None:
    found = evaluate(loop, Monitor(), lpips=lambda a, b: float(np.abs(np.subtract(a, b)).mean()))
    assert {view.name for view in found.views} == {"00.png", "04.png", "08.png", "12.png"}
    view = ring.by_name["04.png"]
    model = loop.scene.train("full", Monitor())
    render = loop.scene.rasterizer.render(
        model.gaussians, loop.scene.expected_camera("04.png"), view.camera_from_model, sh_degree=0
    ).color.detach()
    photograph = load_rgb(ring.image_dir / "04.png").astype(np.float64) / 255
    (measured,) = (quality for quality in found.views if quality.name == "04.png")
    assert measured.psnr_db == pytest.approx(psnr(render.clamp(0, 1).numpy(), photograph), abs=1e-4)
    assert measured.lpips == pytest.approx(np.abs(render.clamp(0, 1).numpy() - photograph).mean(), abs=1e-5)
    assert found.psnr_db == pytest.approx(np.mean([quality.psnr_db for quality in found.views]))
    assert (found.visited, found.registered, found.iterations, found.aligned_only) == (3, 3, 6, ())
    assert found.travel == pytest.approx(loop.travel)
