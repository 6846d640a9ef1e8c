from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from PIL import Image

from fvs_engine.lab.baselines import SELECTORS
from fvs_engine.lab.evaluate import plots
from fvs_engine.lab.evaluate.plots import plot_calibration, plot_quality, plot_travel, spread_out, styles
from fvs_engine.lab.evaluate.protocol import PRESETS
from fvs_engine.lab.evaluate.report import Summary, summarise
from fvs_engine.lab.evaluate.results import Run
from fvs_engine.lab.evaluate.trajectories import on_floor, plot_trajectories

pytestmark = pytest.mark.usefixtures("coarse_pictures")

METHODS = ("farthest", "random", "fisher")
MakeRun = Callable[..., Run]


@pytest.fixture
def summary(make_run: MakeRun) -> Summary:
    runs = [
        make_run(
            method,
            seed,
            {count: 10 + place + seed + count / 10 for count in (5, 10, 20)},
            correlations=dict.fromkeys(METHODS, 0.1 * seed) if method == "farthest" else None,
        )
        for place, method in enumerate(METHODS)
        for seed in range(3)
    ]
    return summarise("room", PRESETS["fisherrf"], runs)


def test_no_two_selectors_look_alike() -> None:
    styled = styles(tuple(SELECTORS))
    assert len(set(styled.values())) == len(SELECTORS)


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Every figure that is saved while the test runs."""
    saved: list[Figure] = []
    save = Figure.savefig

    def remember(self: Figure, *args: object, **options: object) -> None:
        saved.append(self)
        save(self, *args, **options)

    monkeypatch.setattr(Figure, "savefig", remember)
    return saved


def curves(figure: Figure) -> list[dict[str, int]]:
    """Per panel: label → number of points."""
    return [
        {str(line.get_label()): len(line.get_xdata()) for line in axes.lines if line.get_label()[0] != "_"}
        for axes in figure.axes
    ]


def ink(path: Path) -> float:
    """Share of pixels that are not background."""
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("L"))
    assert min(pixels.shape) > 100
    return float((pixels < 250).mean())


def test_every_selector_has_a_curve(summary: Summary, figures: list[Figure], tmp_path: Path) -> None:
    for plot in (plot_quality, plot_travel):
        plot(tmp_path / "plot.png", summary, styles(METHODS))
        assert curves(figures[-1])[0] == dict.fromkeys(METHODS, 3)
        assert ink(tmp_path / "plot.png") > 0.005
    names = {text.get_text() for text in figures[0].axes[0].texts}
    assert set(METHODS) <= names


def test_calibration_has_a_panel_per_view_count(
    summary: Summary, figures: list[Figure], tmp_path: Path
) -> None:
    plot_calibration(tmp_path / "plot.png", summary, styles(METHODS))
    assert [axes.get_title() for axes in figures[0].axes] == ["5 views", "10 views", "20 views"]
    for axes in figures[0].axes:
        marks = [line for line in axes.lines if line.get_marker() not in ("None", "", None)]
        assert len(marks) == len(METHODS)


def test_trajectories_pass_through_all_visited_views(
    summary: Summary, figures: list[Figure], tmp_path: Path
) -> None:
    angles = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    centres = {f"{i:02d}.png": np.array([np.cos(a), 0.1 * i, np.sin(a)]) for i, a in enumerate(angles)}
    runs = [run for run in summary.runs if run.seed == 0]
    plot_trajectories(tmp_path / "plot.png", "ways", runs, centres, styles(METHODS))
    panels = [panel for panel in curves(figures[0]) if panel]
    assert panels == [{"capture": 30, run.method: 20} for run in runs]
    assert ink(tmp_path / "plot.png") > 0.005


def test_selectors_differ_in_colour_and_mark() -> None:
    nine = styles([str(i) for i in range(9)])
    assert len({color for color, _ in nine.values()}) == 9
    assert len({mark for _, mark in nine.values()}) == 9
    assert plots.styles(["a", "b"])["a"] == plots.styles(["a"])["a"]


@given(st.lists(st.floats(0, 1), min_size=1, max_size=9).map(sorted), st.floats(0.01, 0.1))
def test_labels_keep_their_order_and_distance(wanted: list[float], gap: float) -> None:
    placed = spread_out(wanted, gap)
    assert len(placed) == len(wanted)
    assert all(b - a >= gap - 1e-9 for a, b in pairwise(placed))
    if all(b - a > gap for a, b in pairwise(wanted)):
        assert placed == pytest.approx(wanted)
    assert np.mean(placed) == pytest.approx(np.mean(wanted), abs=1e-6)


def test_the_floor_is_the_plane_in_which_cameras_spread() -> None:
    rng = np.random.default_rng(0)
    flat = rng.normal(size=(50, 3)) * [3.0, 0.05, 2.0]  # OpenCV: y is down
    turned = on_floor(flat)
    assert np.ptp(turned, axis=0)[2] < 0.5 < np.ptp(turned, axis=0)[1]
    assert np.corrcoef(turned[:, 2], flat[:, 1])[0, 1] == pytest.approx(-1.0, abs=0.01)
    distances = np.linalg.norm(flat[:, None] - flat[None], axis=-1)
    np.testing.assert_allclose(np.linalg.norm(turned[:, None] - turned[None], axis=-1), distances)
