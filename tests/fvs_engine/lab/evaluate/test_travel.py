"""Experiments with travel as the budget, and with several vehicles."""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from fvs_engine.errors import InvalidInputError
from fvs_engine.lab.evaluate import experiment, run
from fvs_engine.lab.evaluate.experiment import ExperimentFolder, run_experiment
from fvs_engine.lab.evaluate.held_out import psnr_at
from fvs_engine.lab.evaluate.markdown import markdown
from fvs_engine.lab.evaluate.plots import plot_quality, plot_travel, styles
from fvs_engine.lab.evaluate.protocol import PRESETS, QUARTERS, Protocol, protocol_from_preset
from fvs_engine.lab.evaluate.report import Summary, summarise
from fvs_engine.lab.evaluate.results import Run, TravelPoint
from fvs_engine.lab.evaluate.run import Setup
from fvs_engine.lab.evaluate.trajectories import plot_trajectories
from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import path_length
from fvs_engine.scene.dataset import Dataset
from fvs_engine.splat.raster import Rasterizer, create_rasterizer

pytestmark = pytest.mark.usefixtures("coarse_pictures")

MakeRun = Callable[..., Run]
METHODS = ("farthest", "kriging", "nearest")
TRAVEL = 10.0


@pytest.fixture(scope="module")
def cpu() -> Rasterizer:
    return create_rasterizer("cpu")


@pytest.fixture(scope="module", autouse=True)
def no_pictures() -> Iterator[None]:
    """Skip the plots: drawing takes longer than the runs of a small experiment."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment, "_draw", lambda *_: None)
        yield


@pytest.fixture
def protocol(quick: Protocol) -> Protocol:
    return quick.model_copy(
        update={
            "initial_choice": "consecutive",
            "view_counts": (9,),
            "max_travel": TRAVEL,
            "travel_shares": QUARTERS,
        }
    )


def execute(
    folder: Path, ring: Dataset, protocol: Protocol, cpu: Rasterizer, monitor: Monitor | None = None
) -> Summary:
    return run_experiment(folder, ring, protocol, METHODS, (0,), cpu, monitor=monitor or Monitor())


def decided(summary: Summary) -> list[dict[str, object]]:
    return [made.model_dump(exclude={"selection_s", "seconds"}) for made in summary.runs]


def flights(made: Run, ring: Dataset) -> dict[int, list[float]]:
    """Distance flown by each vehicle after each of its chosen views, between the dataset's positions."""
    ways: dict[int, list[str]] = {}
    for name, vehicle in zip(made.order[made.initial :], made.vehicles, strict=True):
        ways.setdefault(vehicle, [made.order[made.initial - 1]]).append(name)
    centres = ring.centres()
    return {
        vehicle: [path_length([centres[name] for name in way[:count]]) for count in range(2, len(way) + 1)]
        for vehicle, way in ways.items()
    }


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    return SimpleNamespace(folder=tmp_path_factory.mktemp("travel"), summary=None)


@pytest.fixture
def whole(done: SimpleNamespace, ring: Dataset, protocol: Protocol, cpu: Rasterizer) -> SimpleNamespace:
    """An experiment that was not interrupted. Tests must not change it."""
    done.summary = done.summary or execute(done.folder, ring, protocol, cpu)
    return done


def test_a_run_is_measured_before_it_exceeds_each_quarter(
    whole: SimpleNamespace, ring: Dataset, protocol: Protocol
) -> None:
    for made in whole.summary.runs:
        (flown,) = flights(made, ring).values()
        assert [point.share for point in made.travel_points] == list(QUARTERS)
        for point in made.travel_points:
            expected = sum(length <= point.share * TRAVEL * (1 + 1e-9) for length in flown)
            assert point.visited == made.initial + expected
            evaluation = made.at_share(point.share)
            assert evaluation is not None
            assert evaluation.visited == point.visited
            assert evaluation.flown == pytest.approx((flown[expected - 1] if expected else 0.0,))
        assert flown[-1] <= TRAVEL * (1 + 1e-9)
        assert made.stop_kind in ("travel", "budget")
        if made.stop_kind == "budget":
            assert len(made.order) == protocol.budget
    ended = {made.method: (made.stop_kind, len(made.order)) for made in whole.summary.runs}
    assert ended["farthest"][0] == "travel"
    assert ended["kriging"][1] > ended["farthest"][1]


def test_what_is_measured_at_a_quarter_is_what_a_run_of_that_travel_ends_with(
    whole: SimpleNamespace, ring: Dataset, protocol: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    """For selectors that do not plan; and the PSNR is that of models of those views alone."""
    half = execute(tmp_path, ring, protocol.model_copy(update={"max_travel": TRAVEL / 2}), cpu)
    for method in ("farthest", "nearest"):
        (long,) = (made for made in whole.summary.runs if made.method == method)
        (short,) = (made for made in half.runs if made.method == method)
        at_half = long.at_share(0.5)
        assert at_half is not None
        assert at_half == short.evaluations[-1] == short.at_share(1.0)
        assert long.order[: at_half.visited] == short.order
    (made,) = (made for made in half.runs if made.method == "farthest")
    setup = Setup(ring, protocol.model_copy(update={"max_travel": TRAVEL / 2}), cpu, None)
    folder = ExperimentFolder(tmp_path).run("farthest", 0) / "selection"
    loop = setup.open(folder, "farthest", 0, Monitor())
    model = loop.scene.train("full", Monitor())
    views = loop.scene.localise(loop.held_out_names, Monitor()).values()
    measured = [psnr_at(model, view, cpu) for view in views]
    assert made.evaluations[-1].psnr_db == pytest.approx(np.mean(measured))


class Killed(BaseException):
    """Stands for a kill: nothing in the engine catches it."""


@pytest.mark.system
@pytest.mark.parametrize("number", [1, 3, 6])
def test_a_run_that_is_killed_while_it_is_measured_goes_on(
    whole: SimpleNamespace,
    ring: Dataset,
    protocol: Protocol,
    cpu: Rasterizer,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    number: int,
) -> None:
    """The last choice on disk then is of a view that was not visited yet."""
    left = [number]
    measure = run.evaluate

    def killed(*given: Any) -> Any:
        left[0] -= 1
        if not left[0]:
            raise Killed
        return measure(*given)

    monkeypatch.setattr(run, "evaluate", killed)
    with pytest.raises(Killed):
        execute(tmp_path, ring, protocol, cpu)
    assert decided(execute(tmp_path, ring, protocol, cpu)) == decided(whole.summary)


@pytest.mark.system
def test_vehicles_have_the_travel_each_and_are_reported_one_by_one(
    whole: SimpleNamespace, ring: Dataset, protocol: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    pair = protocol.model_copy(update={"vehicles": 2})
    summary = execute(tmp_path, ring, pair, cpu)
    for made in summary.runs:
        flown = flights(made, ring)
        last = made.evaluations[-1]
        assert last.flown == pytest.approx([flown[1][-1], flown[2][-1]])
        assert max(last.flown) <= TRAVEL * (1 + 1e-9)
        centres = ring.centres()
        initial = path_length([centres[name] for name in made.order[: made.initial]])
        assert last.travel == pytest.approx(initial + sum(last.flown))
    orders = {made.method: len(made.order) for made in summary.runs}
    alone = {made.method: len(made.order) for made in whole.summary.runs}
    assert orders["farthest"] > alone["farthest"]
    text = (tmp_path / "report.md").read_text()
    assert "| flown by vehicle 1 | flown by vehicle 2 |" in text
    assert "2 vehicles, the one that has flown least next" in text
    (row,) = (row for row in summary.travel_rows if (row.method, row.share) == ("farthest", 1.0))
    (made,) = (made for made in summary.runs if made.method == "farthest")
    assert tuple(lengths.mean for lengths in row.flown) == made.evaluations[-1].flown


def test_time_that_was_up_leaves_shares_unmeasured(
    ring: Dataset, protocol: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    hasty = execute(tmp_path, ring, protocol.model_copy(update={"time_limit_s": 1e-9}), cpu)
    assert all(made.stop_kind == "time-limit" and made.travel_points == () for made in hasty.runs)
    assert hasty.travel_rows == ()
    assert any("time limit" in note for note in hasty.notes)


def test_the_travel_of_the_preset_is_the_length_of_the_capture(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    open_end = quick.model_copy(update={"travel_shares": QUARTERS})
    resolved = open_end.for_dataset(ring)
    centres = ring.centres()
    pool = [name for index, name in enumerate(ring.names) if index % 4]
    assert resolved.max_travel == pytest.approx(path_length([centres[name] for name in pool]))
    assert quick.for_dataset(ring) == quick
    summary = run_experiment(tmp_path, ring, open_end, ("farthest",), (0,), cpu, monitor=Monitor())
    assert summary.protocol == resolved
    again = run_experiment(tmp_path, ring, open_end, ("farthest",), (0,), cpu, monitor=Monitor())
    assert decided(again) == decided(summary)
    still = Dataset("still", ring.image_dir, (ring.views[0],) * 3)
    with pytest.raises(InvalidInputError, match="same position"):
        open_end.model_copy(update={"test_every": 2}).for_dataset(still)


def test_a_travel_given_brings_the_quarters_with_it() -> None:
    assert protocol_from_preset("fisherrf", max_travel=30.0).travel_shares == QUARTERS
    preset = PRESETS["travel"]
    assert (preset.initial_choice, preset.reach, preset.budget) == ("consecutive", "all", 20)
    assert (preset.travel_shares, preset.max_travel) == (QUARTERS, None)
    assert protocol_from_preset("travel", max_travel=7.0, vehicles=2).max_travel == 7.0
    for changes, problem in (
        ({"travel_shares": (0.5, 0.25, 1.0)}, "rise to 1"),
        ({"travel_shares": (0.5,)}, "rise to 1"),
        ({"travel_shares": (), "max_travel": 3.0}, "needs travel_shares"),
        ({"max_travel": 0.0}, "max_travel"),
        ({"vehicles": 21}, "vehicles"),
    ):
        with pytest.raises(InvalidInputError, match=problem):
            protocol_from_preset("travel", **changes)


@pytest.fixture
def summary(make_run: MakeRun) -> Summary:
    """``farthest`` gets to 6, 8 and 10 views, ``kriging`` has its last ones from the half on."""
    runs = []
    for seed, luck in enumerate((0.0, 1.0, 5.0)):
        psnr = {5: 15 + luck, 6: 16 + luck, 8: 18 + luck, 10: 20 + luck}
        for method, gain, counts in (("farthest", 0.0, (5, 6, 8, 10)), ("kriging", 3.0, (8, 10, 10, 10))):
            made = make_run(method, seed, {count: psnr[count] + gain for count in sorted(set(counts))})
            points = tuple(TravelPoint(share=s, visited=n) for s, n in zip(QUARTERS, counts, strict=True))
            changes = {"travel_points": points, "stop_kind": "travel"}
            runs.append(made.model_copy(update=changes))
    protocol = PRESETS["travel"].model_copy(update={"max_travel": 40.0})
    return summarise("room", protocol, runs)


def test_the_table_has_a_row_per_quarter(summary: Summary) -> None:
    found = {(row.method, row.share): row for row in summary.travel_rows}
    assert len(found) == len(summary.travel_rows) == 8
    assert [found["kriging", share].psnr_db.mean for share in QUARTERS] == pytest.approx([23, 25, 25, 25])
    assert [found["farthest", share].views.mean for share in QUARTERS] == [5, 6, 8, 10]
    assert [found["farthest", share].limit for share in QUARTERS] == [10, 20, 30, 40]
    gain = found["kriging", 0.25].gains["farthest"]
    assert (gain.mean, gain.half_width) == (pytest.approx(6.0), pytest.approx(0.0, abs=1e-9))
    assert summary.rows == ()  # none has 20 views, and no other number was asked for
    assert summary.notes == ()  # to end by the travel is what they are to do
    assert Summary.model_validate_json(summary.model_dump_json()) == summary


def test_the_report_has_the_travel_first(summary: Summary) -> None:
    text = markdown(summary)
    assert "flies at most 40 after the initial views" in text
    assert "| selector | 10 (25%) | 20 (50%) | 30 (75%) | 40 (100%) |" in text
    line = next(line for line in text.splitlines() if line.startswith("| kriging | 23.00"))
    assert "(8 views)" in line
    assert line.count("25.00") == 3
    heads = [line for line in text.splitlines() if line.startswith("## ")]
    assert heads[0] == "## PSNR dB within a travel"
    assert heads[1:] == [
        "## Within a travel of 40 (100%)",
        "## Within a travel of 30 (75%)",
        "## Within a travel of 20 (50%)",
        "## Within a travel of 10 (25%)",
    ]


def test_plots_are_over_travel(summary: Summary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saved: list[Figure] = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **o: saved.append(self) or save(self, *a, **o))
    styled = styles(("farthest", "kriging"))
    plot_quality(tmp_path / "psnr.png", summary, styled)
    plot_travel(tmp_path / "travel.png", summary, styled)
    panels = [saved[0].axes[0], *saved[1].axes]
    lines = [{str(line.get_label()): line.get_xydata().tolist() for line in axes.lines} for axes in panels]
    assert lines[0]["kriging"] == [[10, 23], [20, 25], [30, 25], [40, 25]]
    assert lines[1]["farthest"] == [[10, 5], [20, 6], [30, 8], [40, 10]]
    assert [x for x, _ in lines[2]["farthest"]] == [10, 12, 16, 20]  # what was flown
    assert "travel" in saved[0].axes[0].get_xlabel()


def test_each_vehicle_has_its_own_path(
    make_run: MakeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved: list[Figure] = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **o: saved.append(self) or save(self, *a, **o))
    made = make_run("farthest", 0, {8: 20.0}).model_copy(update={"vehicles": (1, 2, 1, 2)})
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    centres = {f"{i:02d}.png": np.array([np.cos(a), 0.0, np.sin(a)]) for i, a in enumerate(angles)}
    plot_trajectories(tmp_path / "plot.png", "ways", [made], centres, styles(("farthest",)))
    axes = saved[0].axes[0]
    color = styles(("farthest",))["farthest"][0]
    ways = [line for line in axes.lines if line.get_color() == color and line.get_linewidth() == 1.3]
    assert [len(line.get_xdata()) for line in ways] == [6, 3]
    step = 2 * np.sin(np.pi / 8)
    chord = 2 * np.sin(np.pi / 4)
    expected = 3 * step + (step + chord) + (chord + chord)
    assert axes.get_title() == f"farthest: {expected:.1f} units"
