"""A run of one selector with one seed under one protocol: resumable, evaluated at given view counts."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fvs_engine.errors import StorageError
from fvs_engine.files.record import write_record
from fvs_engine.files.storage import storage_errors
from fvs_engine.lab.baselines import create_selector
from fvs_engine.lab.evaluate.calibration import calibrate
from fvs_engine.lab.evaluate.held_out import Lpips, evaluate
from fvs_engine.lab.evaluate.protocol import Protocol
from fvs_engine.lab.evaluate.results import Calibration, Evaluation, Run, TravelPoint, read_result
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.settings import SCENE_TRAINING, SceneSettings, prior_noise
from fvs_engine.select.loop import Choice, LoopSettings, SelectionLoop, StopReason
from fvs_engine.select.loop_folder import LoopFolder, SelectionManifest
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.splat.raster import Rasterizer

_TOLERANCE = 1e-9
"""Share of a travel by which rounding may exceed it."""


@dataclass(frozen=True)
class RunPlan:
    """A run to do; the scores of ``calibrated`` methods are recorded at every evaluation.

    A run that a shorter limit than ``time_limit_s`` ended is not finished.
    The folder of a run holds ``selection/`` (the loop's own), ``evaluation-0010.json`` and
    ``calibration-0010.json`` per view count, and ``run.json`` once it is finished.
    """

    folder: Path
    method: str
    seed: int
    calibrated: tuple[str, ...] = ()
    time_limit_s: float | None = None

    @property
    def result_path(self) -> Path:
        """Exists when the run is finished."""
        return self.folder / "run.json"

    def result(self) -> Run | None:
        """The finished run; None while something is left to do."""
        run = read_result(self.result_path, Run)
        if run is None or run.may_go_on(self.time_limit_s) or not self.is_complete():
            return None
        return run

    def is_complete(self) -> bool:
        """Whether every evaluation so far has the calibrations of this plan."""
        numbers = (path.name.removeprefix("evaluation-") for path in self.folder.glob("evaluation-*.json"))
        known = (read_result(self.folder / f"calibration-{number}", Calibration) for number in numbers)
        return not self.calibrated or all(_covers(calibration, self.calibrated) for calibration in known)


@dataclass(frozen=True, eq=False)
class Setup:
    """Dataset, protocol and rasteriser that all runs of an experiment share."""

    dataset: Dataset
    protocol: Protocol
    rasterizer: Rasterizer
    lpips: Lpips | None
    threads: int | None = None

    def settings(self, method: str, seed: int) -> LoopSettings:
        """The loop's settings for one run."""
        protocol = self.protocol
        everything = len(self.dataset.views) if protocol.reach == "all" else None
        scene = SceneSettings(
            poses=protocol.poses,
            prior_noise=prior_noise(
                protocol.priors, protocol.position_noise_percent, protocol.orientation_noise_deg
            ),
            long_side_px=protocol.long_side_px,
            initial_iterations=protocol.initial_iterations,
            iterations_per_view=protocol.iterations_per_view,
            training=SCENE_TRAINING.model_copy(update={"max_gaussians": protocol.max_gaussians}),
            sfm=SfmSettings(seed=seed, threads=self.threads or 1),  # one thread: reproducible
            seed=seed,
        )
        return LoopSettings(
            scene=scene,
            method=method,
            budget=protocol.budget,
            nearest=everything or protocol.nearest,
            seed=seed,
            **protocol.model_dump(include=LoopSettings.model_fields.keys() - {"nearest"}),
        )

    def open(self, folder: Path, method: str, seed: int, monitor: Monitor) -> SelectionLoop:
        """The loop of one run, begun or resumed."""
        settings, selector = self.settings(method, seed), create_selector(method)
        return SelectionLoop.open(folder, self.dataset, settings, selector, self.rasterizer, monitor)


def make_start(setup: Setup, folder: Path, method: str, seed: int, monitor: Monitor) -> Path:
    """A selection trained on its initial views that has chosen nothing, in ``folder / selection``.

    Its models do not depend on the method, so that all methods of a seed can begin with them.
    """
    finished = folder / "finished"
    if not finished.exists():
        selection = folder / "selection"
        earlier = LoopFolder(selection).manifest()
        if earlier is not None:  # it may have been created for another method
            method = earlier.settings.method
        loop = setup.open(selection, method, seed, monitor)
        loop.begin(monitor)
        if len(loop.initial) in setup.protocol.view_counts:
            loop.scene.train("full", monitor)
        finished.touch()
    return folder / "selection"


def execute(
    setup: Setup,
    plan: RunPlan,
    start: Path,
    monitor: Monitor,
    on_step: Callable[[int, Evaluation | None], None],
) -> Run:
    """Finish a run. ``on_step(visited views, the last evaluation)`` is called after every step.

    A run that lacks a calibration of the plan starts again: its earlier models are not kept.
    Raises ``Cancelled`` with everything on disk, and what the loop raises.
    """
    if not plan.is_complete():
        shutil.rmtree(plan.folder)
    selection = plan.folder / "selection"
    if not selection.exists():
        _fork(start, selection, setup.settings(plan.method, plan.seed))
    loop = setup.open(selection, plan.method, plan.seed, monitor)
    loop.begin(monitor)
    evaluation: Evaluation | None = None
    while True:
        visited = len(loop.visited)
        if visited in setup.protocol.view_counts:
            trainings = setup.protocol.trainings if visited == setup.protocol.budget else 1
            evaluation = _evaluate(setup, plan, loop, monitor, trainings)
        on_step(visited, evaluation)
        outcome = loop.choose(monitor)
        if isinstance(outcome, StopReason):
            break
        if _passes(setup.protocol, loop, outcome):
            evaluation = _evaluate(setup, plan, loop, monitor, 1)
            on_step(visited, evaluation)
        loop.step(monitor)
    _evaluate(setup, plan, loop, monitor, setup.protocol.trainings)
    run = _result(setup.protocol, plan, loop, outcome)
    write_record(plan.result_path, run)
    return run


def _limits(protocol: Protocol) -> dict[float, float]:
    """The maximum travel of a vehicle at each share of it."""
    whole = (protocol.max_travel or 0.0) * (1 + _TOLERANCE)
    return {share: share * whole for share in protocol.travel_shares}


def _passes(protocol: Protocol, loop: SelectionLoop, choice: Choice) -> bool:
    """Whether a choice is the first to take a vehicle beyond a share of the travel."""
    flown = [vehicle.flown for vehicle in loop.vehicles.all]
    after = flown[choice.vehicle - 1] + choice.distance
    return any(max(flown) <= limit < after for limit in _limits(protocol).values())


def _travel_points(protocol: Protocol, loop: SelectionLoop, stop: StopReason) -> tuple[TravelPoint, ...]:
    """The views before any vehicle went beyond each share; all where none did, unless time was up."""
    flown = dict.fromkeys(range(1, protocol.vehicles + 1), 0.0)
    longest = []
    for record in loop.records:
        flown[record.choice.vehicle] += record.choice.distance
        longest.append(max(flown.values()))
    points = []
    for share, limit in _limits(protocol).items():
        count = sum(length <= limit for length in longest)
        if count < len(longest) or stop.kind != "time-limit":
            points.append(TravelPoint(share=share, visited=len(loop.initial) + count))
    return tuple(points)


def _evaluate(
    setup: Setup, plan: RunPlan, loop: SelectionLoop, monitor: Monitor, trainings: int
) -> Evaluation:
    """Evaluate and calibrate the current model, unless that was done before with so many trainings."""
    visited = len(loop.visited)
    path = plan.folder / f"evaluation-{visited:04d}.json"
    evaluation = read_result(path, Evaluation)
    if evaluation is None or 1 + len(evaluation.repeats) < trainings:
        if plan.calibrated:  # first, so that no evaluation is ever without it
            calibration = calibrate(loop, plan.calibrated, monitor)
            write_record(plan.folder / f"calibration-{visited:04d}.json", calibration)
        evaluation = evaluate(loop, monitor, setup.lpips, trainings)
        write_record(path, evaluation)
    return evaluation


def _result(protocol: Protocol, plan: RunPlan, loop: SelectionLoop, stop: StopReason) -> Run:
    visited = len(loop.visited)
    points = _travel_points(protocol, loop, stop)
    measured = {visited, *protocol.view_counts, *(point.visited for point in points)}
    counts = [n for n in range(len(loop.initial), visited + 1) if n in measured]
    evaluations = (read_result(plan.folder / f"evaluation-{n:04d}.json", Evaluation) for n in counts)
    calibrations = (read_result(plan.folder / f"calibration-{n:04d}.json", Calibration) for n in counts)
    rms = [record.alignment.rms for record in loop.records if record.alignment.source != "known"]
    return Run(
        method=plan.method,
        seed=plan.seed,
        initial=len(loop.initial),
        order=loop.visited,
        evaluations=tuple(evaluation for evaluation in evaluations if evaluation is not None),
        calibrations=tuple(calibration for calibration in calibrations if calibration is not None),
        selection_s=tuple(record.seconds.score for record in loop.records),
        fallbacks=sum(record.choice.fallback is not None for record in loop.records),
        worst_rms=max(rms, default=None),
        stop=stop.message,
        seconds=sum(record.seconds.total for record in loop.records),
        time_limit_s=protocol.time_limit_s if stop.kind == "time-limit" else None,
        stop_kind=stop.kind,
        vehicles=tuple(record.choice.vehicle for record in loop.records),
        travel_points=points,
    )


def _covers(calibration: Calibration | None, methods: Sequence[str]) -> bool:
    return calibration is not None and set(methods) <= {entry.method for entry in calibration.selectors}


def _manifest_of(selection: Path) -> SelectionManifest:
    manifest = LoopFolder(selection).manifest()
    if manifest is None:
        raise StorageError(f"{selection} holds no selection.", hint="Delete the folder.")
    return manifest


def _fork(start: Path, selection: Path, settings: LoopSettings) -> None:
    """Copy a selection that has chosen nothing yet, to continue with other settings; whole or not at all."""
    partial = selection.with_name(f".{selection.name}.partial")
    with storage_errors(selection):
        shutil.rmtree(partial, ignore_errors=True)
        shutil.copytree(start, partial)
        manifest = _manifest_of(partial).model_copy(update={"settings": settings})
        LoopFolder(partial).write_manifest(manifest)
        partial.rename(selection)
