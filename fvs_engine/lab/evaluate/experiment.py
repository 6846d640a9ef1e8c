"""Experiments: selectors × seeds under one protocol. Runs are independent; finished ones are not repeated."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fvs_engine.errors import Cancelled, EngineError, InvalidInputError, StorageError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.files.owned_folder import OwnedFolder, differences
from fvs_engine.files.record import write_record
from fvs_engine.hold_out import hold_out
from fvs_engine.lab.baselines import SELECTORS, create_selector
from fvs_engine.lab.evaluate.lpips import find_lpips
from fvs_engine.lab.evaluate.markdown import markdown
from fvs_engine.lab.evaluate.plots import plot_calibration, plot_quality, plot_travel, styles
from fvs_engine.lab.evaluate.protocol import Protocol
from fvs_engine.lab.evaluate.report import BASELINES, Summary, summarise
from fvs_engine.lab.evaluate.results import Evaluation, Run, read_result
from fvs_engine.lab.evaluate.run import RunPlan, Setup, execute, make_start
from fvs_engine.lab.evaluate.trajectories import plot_trajectories
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.records import Record
from fvs_engine.scene.dataset import Dataset
from fvs_engine.select.loop_folder import fingerprint
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.wording import sentence, text
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.stages import Stage


class ExperimentIdentity(Record):
    """``experiment.json``: the protocol and the dataset of the runs beside it."""

    dataset: str
    fingerprint: str
    protocol: Protocol


@dataclass(frozen=True)
class ExperimentFolder:
    """The paths of an experiment.

    experiment.json         protocol and dataset
    starts/seed-0/          the common start of all selectors of a seed
    runs/farthest-seed-0/   one run
    report.json, report.md  the table; psnr.png, travel.png, trajectories.png, calibration.png
    """

    root: Path

    def start(self, seed: int) -> Path:
        """The common start of all selectors of a seed."""
        return self.root / "starts" / f"seed-{seed}"

    def run(self, method: str, seed: int) -> Path:
        """The folder of one run."""
        return self.root / "runs" / f"{method}-seed-{seed}"

    def finished(self) -> tuple[Run, ...]:
        """All finished runs, by seed and in the order of the table of selectors."""
        order: dict[str, int] = {method: index for index, method in enumerate(SELECTORS)}
        found = (read_result(path, Run) for path in self.root.glob("runs/*/run.json"))
        runs = [run for run in found if run is not None]
        return tuple(sorted(runs, key=lambda run: (run.seed, order.get(run.method, len(order)), run.method)))

    def claim(self, dataset: Dataset, protocol: Protocol) -> None:
        """Create the folder, or check that it holds runs of this dataset under this protocol.

        The time limit may differ: runs that a shorter one ended continue. Raises ``OutputExistsError`` when
        it holds something else.
        """
        given = ExperimentIdentity(dataset=dataset.name, fingerprint=fingerprint(dataset), protocol=protocol)
        owned = OwnedFolder(self.root, "experiment.json", ExperimentIdentity, "experiment")
        earlier = owned.read()
        if earlier is None:
            owned.create()
            owned.write(given)
            return
        changeable = {"time_limit_s"}
        found = differences(
            earlier.protocol.model_dump(exclude=changeable), protocol.model_dump(exclude=changeable)
        )
        if earlier.fingerprint != given.fingerprint:
            found.append("the dataset's photographs, masks or poses differ")
        owned.require_same(found)


def run_experiment(
    folder: Path,
    dataset: Dataset,
    protocol: Protocol,
    methods: Sequence[str],
    seeds: Sequence[int],
    rasterizer: Rasterizer,
    *,
    calibrated: bool = False,
    threads: int | None = None,
    monitor: Monitor,
) -> Summary:
    """Run every method with every seed and write the report; finished runs are only read.

    The report is written after every run, so that a stop leaves one. A run that fails is named in it and
    retried by the next call; the others continue. ``calibrated``: in the runs of one method (``farthest``
    when it is among them, else the first), the scores of all methods are recorded.

    Stage ``experiment``, in views added over all runs. Raises ``InvalidInputError`` for unknown methods, a
    dataset that is too small, and no methods or seeds; ``OutputExistsError`` when ``folder`` holds something
    else; ``Cancelled``; the first error of a run when all failed.
    """
    _check(dataset, protocol, methods, seeds)
    protocol = protocol.for_dataset(dataset)
    paths = ExperimentFolder(folder)
    paths.claim(dataset, protocol)
    lpips = find_lpips(rasterizer.device)
    setup = Setup(dataset, protocol, rasterizer, lpips.compute, threads)
    notes = [f"LPIPS is left out: {lpips.reason}."] if lpips.compute is None else []
    notes += map(text, dataset.warnings)
    guide = BASELINES[0] if BASELINES[0] in methods else methods[0]
    plans = [
        RunPlan(
            paths.run(method, seed),
            method,
            seed,
            tuple(methods) if calibrated and method == guide else (),
            protocol.time_limit_s,
        )
        for seed in seeds
        for method in methods
    ]
    progress = _Progress(monitor, protocol, plans)
    errors: list[EngineError] = []
    for plan in plans:
        if plan.result() is None:
            try:
                start = make_start(setup, paths.start(plan.seed), plan.method, plan.seed, progress.quiet)
                execute(setup, plan, start, progress.quiet, progress.of(plan))
            except (Cancelled, StorageError):
                raise
            except EngineError as error:
                errors.append(error)
                failed = Finding.of(
                    FindingCode.RUN_FAILED, method=plan.method, seed=plan.seed, error=str(error)
                )
                notes.append(sentence(failed))
                monitor.warn(failed)
            else:
                _write(paths, summarise(dataset.name, protocol, paths.finished(), notes))
        progress.ended(plan)
    runs = paths.finished()
    if not runs:
        raise errors[0]
    summary = summarise(dataset.name, protocol, runs, notes)
    _write(paths, summary)
    _draw(paths, summary, dataset)
    return summary


def _check(dataset: Dataset, protocol: Protocol, methods: Sequence[str], seeds: Sequence[int]) -> None:
    if not methods or not seeds:
        raise InvalidInputError("An experiment needs at least one method and one seed.")
    for method in methods:
        create_selector(method)
    for kind, given in (("method", methods), ("seed", seeds)):
        if len(set(given)) < len(given):
            raise InvalidInputError(f"A {kind} is given twice: {', '.join(map(str, given))}.")
    if min(seeds) < 0:
        raise InvalidInputError(f"A seed cannot be negative, as {min(seeds)} is.")
    pool, held_out = hold_out(dataset.names, protocol.test_every, protocol.hold_out)
    if not held_out:
        raise InvalidInputError(
            f"{dataset.name} has {len(pool)} views: too few to hold out every {protocol.test_every}th.",
            hint="Give a smaller --test-every, or more photographs.",
        )
    if len(pool) < protocol.budget:
        raise InvalidInputError(
            f"{protocol.budget} views are to be visited, but {dataset.name} has only {len(pool)} to visit: "
            f"{len(dataset.views)} photographs with poses, of which {len(held_out)} are held out.",
            hint=f"Give --views of at most {len(pool)}.",
        )


def _write(paths: ExperimentFolder, summary: Summary) -> None:
    write_record(paths.root / "report.json", summary)
    write_text_atomically(paths.root / "report.md", markdown(summary))


def _draw(paths: ExperimentFolder, summary: Summary, dataset: Dataset) -> None:
    styled = styles(tuple(SELECTORS))  # of all, so that a method has the same colour in every report
    plot_quality(paths.root / "psnr.png", summary, styled)
    plot_travel(paths.root / "travel.png", summary, styled)
    if summary.correlations:
        plot_calibration(paths.root / "calibration.png", summary, styled)
    first = [run for run in summary.runs if run.seed == summary.runs[0].seed]
    title = f"{summary.dataset}, {summary.protocol.name}, seed {summary.runs[0].seed}: camera paths"
    plot_trajectories(paths.root / "trajectories.png", title, first, dataset.centres(), styled)


class _Quiet(Monitor):
    """Forwards requests to stop, and drops a run's own reports."""

    def __init__(self, outer: Monitor) -> None:
        super().__init__()
        self._outer = outer

    def receive(self, progress: Progress) -> None:
        """See ``Monitor``; drops the report."""

    @property
    def cancelled(self) -> bool:
        """See ``Monitor``."""
        return self._outer.cancelled

    def check(self) -> None:
        """See ``Monitor``."""
        self._outer.check()


class _Progress:
    """Reports the views added over all runs."""

    def __init__(self, monitor: Monitor, protocol: Protocol, plans: Sequence[RunPlan]) -> None:
        self.quiet = _Quiet(monitor)
        self._monitor = monitor
        self._initial = protocol.initial
        self._per_run = protocol.budget - protocol.initial
        self._total = self._per_run * len(plans)
        self._before = 0

    def of(self, plan: RunPlan) -> Callable[[int, Evaluation | None], None]:
        """The callback of one run, after each of its steps."""

        def on_step(visited: int, evaluation: Evaluation | None) -> None:
            measured = {} if evaluation is None else {"psnr_db": evaluation.psnr_db}
            done, run = self._before + visited - self._initial, f"{plan.method} {plan.seed}"
            self._monitor.report(Stage.EXPERIMENT, done, self._total, run=run, views=visited, **measured)

        return on_step

    def ended(self, plan: RunPlan) -> None:
        """Count a run as complete, also one that ended early or was read from disk."""
        self._before += self._per_run
        self._monitor.report(Stage.EXPERIMENT, self._before, self._total, run=f"{plan.method} {plan.seed}")
