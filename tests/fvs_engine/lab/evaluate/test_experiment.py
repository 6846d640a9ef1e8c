import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fvs_engine.errors import Cancelled, InvalidInputError, OutputExistsError, TrainingError
from fvs_engine.lab.evaluate import experiment
from fvs_engine.lab.evaluate.experiment import ExperimentFolder, run_experiment
from fvs_engine.lab.evaluate.held_out import psnr_at
from fvs_engine.lab.evaluate.protocol import Protocol
from fvs_engine.lab.evaluate.report import Summary
from fvs_engine.lab.evaluate.results import Run
from fvs_engine.lab.evaluate.run import RunPlan, Setup
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.scene.dataset import Dataset
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_schema.findings import Finding

pytestmark = pytest.mark.usefixtures("coarse_pictures")

METHODS = ("farthest", "random")
DRAW = experiment._draw


@pytest.fixture(scope="module")
def cpu() -> Rasterizer:
    return create_rasterizer("cpu")


@pytest.fixture(scope="module", autouse=True)
def no_pictures() -> Iterator[None]:
    """Skip the plots: drawing takes longer than the runs of a small experiment. See ``with_pictures``."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment, "_draw", lambda *_: None)
        yield


@pytest.fixture
def with_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiment, "_draw", DRAW)


def run(
    folder: Path,
    ring: Dataset,
    protocol: Protocol,
    cpu: Rasterizer,
    *,
    methods: tuple[str, ...] = METHODS,
    seeds: tuple[int, ...] = (0, 1),
    monitor: Monitor | None = None,
    calibrated: bool = False,
    said: list[Finding] | None = None,
) -> Summary:
    monitor = monitor or Monitor(on_warning=None if said is None else said.append)
    return run_experiment(
        folder,
        ring,
        protocol,
        methods,
        seeds,
        cpu,
        calibrated=calibrated,
        monitor=monitor,
    )


def decided(summary: Summary) -> list[dict[str, object]]:
    """All of the runs that does not depend on the time."""
    return [run.model_dump(exclude={"selection_s", "seconds"}) for run in summary.runs]


def test_several_trainings_of_the_last_views_are_averaged(
    tmp_path: Path, ring: Dataset, quick: Protocol, cpu: Rasterizer
) -> None:
    one = run(tmp_path / "one", ring, quick, cpu, seeds=(0,))
    protocol = quick.model_copy(update={"trainings": 3})
    three = run(tmp_path / "three", ring, protocol, cpu, seeds=(0,))
    for before, after in zip(one.runs, three.runs, strict=True):
        assert after.order == before.order
        early, last = after.evaluations
        assert early == before.evaluations[0]
        assert last.model_copy(update={"repeats": ()}) == before.evaluations[1]
        assert [repeat.seed for repeat in last.repeats] == [1_000, 2_000]
        values = [last.psnr_db, *(repeat.psnr_db for repeat in last.repeats)]
        assert len(set(values)) == 3
        row = next(r for r in three.rows if (r.method, r.visited) == (after.method, 5))
        assert row.psnr_db.mean == pytest.approx(np.mean(values))
        assert row.training_sd_db is not None
        assert row.training_sd_db.mean == pytest.approx(np.std(values, ddof=1))
        assert all(repeat.unvisited_db is not None for repeat in last.repeats)
    assert "SD of trainings" in (tmp_path / "three" / "report.md").read_text()
    assert "SD of trainings" not in (tmp_path / "one" / "report.md").read_text()


def test_a_run_that_ends_early_trains_its_last_views_as_often(
    tmp_path: Path, ring: Dataset, quick: Protocol, cpu: Rasterizer
) -> None:
    hasty = quick.model_copy(update={"time_limit_s": 1e-3, "trainings": 2})
    (ended,) = run(tmp_path, ring, hasty, cpu, methods=("farthest",), seeds=(0,)).runs
    assert len(ended.order) < hasty.budget
    assert [len(evaluation.repeats) for evaluation in ended.evaluations][-1] == 1


def test_unvisited_views_are_measured(
    tmp_path: Path, ring: Dataset, quick: Protocol, cpu: Rasterizer
) -> None:
    """Of the model that is there, at the views that are neither held out nor visited."""
    summary = run(tmp_path, ring, quick, cpu, methods=("farthest", "random"), seeds=(0,))
    setup = Setup(ring, quick, cpu, None)
    for finished in summary.runs:
        folder = ExperimentFolder(tmp_path).run(finished.method, 0) / "selection"
        loop = setup.open(folder, finished.method, 0, Monitor())
        model = loop.scene.train("full", Monitor())
        left = [name for name in ring.names if name not in (*finished.order, *loop.held_out_names)]
        views = loop.scene.localise(left, Monitor()).values()
        expected = np.mean([psnr_at(model, view, cpu) for view in views])
        assert finished.evaluations[-1].unvisited_db == pytest.approx(expected)
    text = (tmp_path / "report.md").read_text()
    assert "unvisited dB" in text
    assert "unvisited, over farthest" in text


class Killed(BaseException):
    """As good as a kill: nothing in the engine catches it, and nothing is saved on its way."""


def stop_after(count: int, *, killed: bool) -> Monitor:
    """Asks to stop at the ``count``-th report, or ends there without asking."""
    reports: list[Progress] = []

    def on_progress(progress: Progress) -> None:
        reports.append(progress)
        if len(reports) == count:
            if killed:
                raise Killed
            monitor.cancel()

    monitor = Monitor(on_progress)
    return monitor


@pytest.mark.system
@pytest.mark.usefixtures("with_pictures")
def test_runs_of_one_seed_differ_by_the_selector_alone(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    summary = run(tmp_path / "out", ring, quick, cpu, calibrated=True)
    assert [(run.method, run.seed) for run in summary.runs] == [
        ("random", 0),
        ("farthest", 0),
        ("random", 1),
        ("farthest", 1),
    ]
    starts = {}
    for made in summary.runs:
        assert [evaluation.visited for evaluation in made.evaluations] == [3, 5]
        assert len(made.order) == len(set(made.order)) == 5
        assert not {"00.png", "04.png", "08.png", "12.png"} & set(made.order)  # held out
        begun = (made.order[:3], made.evaluations[0])
        assert starts.setdefault(made.seed, begun) == begun
    assert starts[0] != starts[1]
    assert {row.method for row in summary.correlations} == set(METHODS)
    assert [len(made.calibrations) for made in summary.runs] == [0, 2, 0, 2]
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {
        "report.json",
        "report.md",
        "psnr.png",
        "travel.png",
        "trajectories.png",
        "calibration.png",
    } <= names
    assert Summary.model_validate_json((tmp_path / "out" / "report.json").read_text()) == summary
    with pytest.raises(OutputExistsError, match="long_side_px was 64 and is 80"):
        run(tmp_path / "out", ring, quick.model_copy(update={"long_side_px": 80}), cpu)


def test_a_shared_start_is_what_a_run_would_have_made_itself(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    together = run(tmp_path / "together", ring, quick, cpu, seeds=(0,))
    alone = run(tmp_path / "alone", ring, quick, cpu, methods=("random",), seeds=(0,))
    (made,) = (found for found in decided(together) if found["method"] == "random")
    assert decided(alone) == [made]


@pytest.fixture(scope="module")
def whole(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, tmp_path_factory: pytest.TempPathFactory
) -> Summary:
    """An experiment that nobody stopped."""
    return run(tmp_path_factory.mktemp("whole"), ring, quick, cpu)


@pytest.mark.parametrize(("reports", "killed"), [(2, True), (6, False), (7, True)])
def test_a_stopped_experiment_goes_on_and_repeats_no_finished_run(
    ring: Dataset,
    quick: Protocol,
    cpu: Rasterizer,
    whole: Summary,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    reports: int,
    killed: bool,
) -> None:
    with pytest.raises(Killed if killed else Cancelled):
        run(tmp_path, ring, quick, cpu, monitor=stop_after(reports, killed=killed))
    finished = {path: path.stat().st_mtime_ns for path in tmp_path.glob("runs/*/run.json")}
    executed: list[str] = []
    execute = experiment.execute

    def counted(laboratory: object, plan: RunPlan, *others: object) -> Run:
        executed.append(plan.folder.name)
        return execute(laboratory, plan, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(experiment, "execute", counted)
    assert decided(run(tmp_path, ring, quick, cpu)) == decided(whole)
    assert len(executed) == 4 - len(finished)
    assert {path: path.stat().st_mtime_ns for path in finished} == finished
    executed.clear()
    assert decided(run(tmp_path, ring, quick, cpu)) == decided(whole)
    assert executed == []


@pytest.mark.system
def test_runs_that_had_too_little_time_go_on_with_more(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, whole: Summary, tmp_path: Path
) -> None:
    hasty = quick.model_copy(update={"time_limit_s": 1e-3})
    short = run(tmp_path, ring, hasty, cpu)
    assert {len(made.order) for made in short.runs} == {3}
    assert run(tmp_path, ring, hasty, cpu) == short  # the same limit is no reason to try again
    assert decided(run(tmp_path, ring, quick, cpu)) == decided(whole)


def test_other_methods_join_those_that_are_there(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    run(tmp_path, ring, quick, cpu, methods=("farthest",), seeds=(0,))
    joined = run(tmp_path, ring, quick, cpu, methods=("random",), seeds=(0,))
    assert [made.method for made in joined.runs] == ["random", "farthest"]
    assert all(row.psnr_db.count == 1 for row in joined.rows)


def test_a_calibration_asked_for_later_is_made_at_every_view_count(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    without = run(tmp_path, ring, quick, cpu, seeds=(0,))
    later = run(tmp_path, ring, quick, cpu, seeds=(0,), calibrated=True)
    assert [row.visited for row in later.correlations] == [3, 3, 5, 5]
    assert [made.order for made in later.runs] == [made.order for made in without.runs]
    assert later.rows[0].psnr_db == without.rows[0].psnr_db


@pytest.mark.usefixtures("with_pictures")
def test_a_run_that_fails_is_named_and_the_others_go_on(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    execute = experiment.execute

    def fails_for_random(laboratory: object, plan: RunPlan, *others: object) -> Run:
        if plan.method == "random":
            raise TrainingError("The loss is no number.")
        return execute(laboratory, plan, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(experiment, "execute", fails_for_random)
    said: list[Finding] = []
    summary = run(tmp_path, ring, quick, cpu, seeds=(0,), said=said, calibrated=True)
    assert (tmp_path / "calibration.png").exists()  # its scores are known even so
    assert [made.method for made in summary.runs] == ["farthest"]
    assert any("random, seed 0, failed: The loss is no number." in note for note in summary.notes)
    assert len(said) == 1
    with pytest.raises(TrainingError):
        run(tmp_path / "alone", ring, quick, cpu, methods=("random",), seeds=(0,))


def test_progress_counts_the_views_of_all_runs(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    reports: list[Progress] = []
    run(tmp_path, ring, quick, cpu, monitor=Monitor(reports.append))
    assert {report.stage for report in reports} == {"experiment"}
    assert {report.total for report in reports} == {4 * 2}
    done = [report.done for report in reports]
    assert done == sorted(done)
    assert (done[0], done[-1]) == (0, 8)


@pytest.mark.parametrize(
    ("methods", "seeds", "changes", "problem"),
    [
        (("farthest", "nonsense"), (0,), {}, "nonsense"),
        ((), (0,), {}, "at least one"),
        (("farthest",), (), {}, "at least one"),
        (("farthest", "farthest"), (0,), {}, "twice"),
        (("farthest",), (0, 0), {}, "twice"),
        (("farthest",), (0, -1), {}, "cannot be negative"),
        (("farthest",), (0,), {"view_counts": (3, 11)}, "only 10 to visit"),
        (("farthest",), (0,), {"test_every": 15}, "too few to hold out"),
    ],
)
def test_what_cannot_be_run_is_refused_before_anything_is_written(
    ring: Dataset,
    quick: Protocol,
    cpu: Rasterizer,
    tmp_path: Path,
    methods: tuple[str, ...],
    seeds: tuple[int, ...],
    changes: dict[str, object],
    problem: str,
) -> None:
    with pytest.raises(InvalidInputError, match=problem):
        run(
            tmp_path / "out",
            ring,
            quick.model_copy(update=changes),
            cpu,
            methods=methods,
            seeds=seeds,
        )
    assert not (tmp_path / "out").exists()


def test_a_folder_of_somebody_else_is_left_alone(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    (tmp_path / "thesis.txt").write_text("precious")
    with pytest.raises(OutputExistsError, match=r"thesis\.txt"):
        run(tmp_path, ring, quick, cpu)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_the_experiment_remembers_its_rules(
    ring: Dataset, quick: Protocol, cpu: Rasterizer, tmp_path: Path
) -> None:
    run(tmp_path, ring, quick, cpu, methods=("farthest",), seeds=(0,))
    memory = json.loads((tmp_path / "experiment.json").read_text())
    assert Protocol.model_validate(memory["protocol"]) == quick
    longer = quick.model_copy(update={"time_limit_s": 1e6})
    run(tmp_path, ring, longer, cpu, methods=("farthest",), seeds=(0,))  # a time limit may change
