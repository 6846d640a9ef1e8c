"""Selection of views of a dataset, in an output folder; resumable.

selection.json    settings, the initial views, why it stopped
steps/            one file per step: the ranking, the choice, the quick model's numbers
scene/            the scene as it grew: features, cameras, the training of its models
result.json       the views in the order of their visit, with score, distance and travel
trajectory.png    the path of the camera, from above
point_cloud.ply   the full model of all views, in the layout that splat viewers read
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from fvs_engine.choices import Poses
from fvs_engine.errors import InvalidInputError
from fvs_engine.files.lock import locked_folder
from fvs_engine.files.record import write_record
from fvs_engine.files.storage import storage_errors
from fvs_engine.images.catalog import require_usable
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.selection_request import SelectionRequest
from fvs_engine.plan.distances import path_length
from fvs_engine.plan.plan_records import Expectation
from fvs_engine.records import Record
from fvs_engine.scene.dataset import Dataset, link_masks, open_dataset
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.score.selectors.interface import Selector
from fvs_engine.select.loop import SelectionLoop, StepRecord, StopReason
from fvs_engine.select.trajectory import draw_trajectory
from fvs_engine.splat.ply import write_ply
from fvs_engine.splat.raster import create_rasterizer
from fvs_schema.findings import Finding, FindingCode


class SelectedView(Record):
    """A visited view; ``distance`` from the one before and ``travel`` up to it are in the dataset's unit.

    ``vehicle`` photographed it (None: initial views); the one before is that vehicle's, the travel of all.
    ``score`` is None for initial views, and for choices without a score (``fallback`` names the rule).
    """

    order: int
    name: str
    initial: bool
    registered: bool
    score: float | None
    fallback: str | None
    distance: float
    travel: float
    vehicle: int | None = None


class SelectionResult(Record):
    """``result.json``: what was visited, in order, and why the selection ended.

    ``travel_of_capture`` is the path length through all views that could be visited, in order of capture.
    ``flown``: by each vehicle after the initial views, at most ``max_travel`` (None: no limit).
    ``expected``: of the quick model's renders of all views that could be visited.
    ``worst_rms``: of the alignments between dataset and model, in the dataset's unit. ``iterations`` and
    ``gaussians`` are those of the full model. ``origin``: the zero of its frame in the dataset's coordinates;
    zeros where poses were estimated, in a frame of their own.
    """

    dataset: str
    method: str
    poses: Poses
    views: tuple[SelectedView, ...]
    test: tuple[str, ...]
    stop: StopReason
    radius: float | None
    nearest: int | None
    travel: float
    travel_of_capture: float
    max_travel: float | None
    flown: tuple[float, ...]
    expected: Expectation
    worst_rms: float
    iterations: int
    gaussians: int
    origin: tuple[float, float, float]
    seconds: float


def select_views(
    folder: Path,
    out: Path,
    request: SelectionRequest,
    selector: Selector,
    *,
    colmap: Path | None = None,
    transforms: Path | None = None,
    backend: str = "auto",
    monitor: Monitor | None = None,
) -> SelectionResult:
    """Choose views of the dataset in ``folder`` until the selection ends; results go to the folder ``out``.

    ``selector`` is the one that ``request.method`` names.

    The same call on the same ``out`` resumes. Raises what ``open_dataset`` and ``SelectionLoop`` raise;
    ``out`` then holds the last good state.
    """
    monitor = monitor or Monitor()
    dataset = open_outside(out, folder, colmap, transforms, monitor)
    settings = request.loop_settings(dataset)
    if not (out / "selection.json").exists():  # a truncated image would end it half-way
        require_usable(dataset.image_dir, dataset.names, dataset.masks, monitor=monitor)
    rasterizer = create_rasterizer(backend, monitor)
    with locked_output(out):
        dataset = link_masks(dataset, out)
        loop = SelectionLoop.open(out, dataset, settings, selector, rasterizer, monitor)
        return _run(loop, out, monitor)


def _run(loop: SelectionLoop, out: Path, monitor: Monitor) -> SelectionResult:
    for warning in loop.begin(monitor):
        monitor.warn(warning)
    if loop.scene.unregistered and not loop.records:
        unregistered = loop.scene.unregistered
        monitor.warn(Finding.of(FindingCode.UNREGISTERED, unregistered, of=len(loop.initial)))
    while isinstance(step := loop.step(monitor), StepRecord):
        for warning in step.warnings:
            monitor.warn(warning)
    model = loop.scene.train("full", monitor)
    result = _result(loop, model, step)
    draw_trajectory(
        out / "trajectory.png",
        loop.dataset,
        initial=loop.initial,
        chosen=[record.chosen for record in loop.records],
        vehicles=[record.choice.vehicle for record in loop.records],
        test=loop.held_out_names,
        title=f"{result.dataset} · {result.method} · {len(result.views)} views · "
        f"travel {result.travel:.1f} of {result.travel_of_capture:.1f}",
    )
    write_ply(out / "point_cloud.ply", model.gaussians, result.origin)
    write_record(out / "result.json", result)
    return result


def _result(loop: SelectionLoop, model: SceneModel, stop: StopReason) -> SelectionResult:
    centres = loop.dataset.centres()
    way = [centres[name] for name in loop.visited]
    registered = {view.name for view in loop.scene.views}
    choices = {record.chosen: record.choice for record in loop.records}
    views = []
    for index, name in enumerate(loop.visited):
        choice = choices.get(name)
        views.append(
            SelectedView(
                order=index + 1,
                name=name,
                initial=choice is None,
                registered=name in registered,
                score=choice.score if choice else None,
                fallback=choice.fallback if choice else None,
                distance=choice.distance if choice else path_length(way[max(0, index - 1) : index + 1]),
                travel=choice.travel if choice else path_length(way[: index + 1]),
                vehicle=choice.vehicle if choice else None,
            )
        )
    return SelectionResult(
        dataset=loop.dataset.name,
        method=loop.settings.method,
        poses=loop.settings.scene.poses,
        views=tuple(views),
        test=loop.held_out_names,
        stop=stop,
        radius=loop.reach.radius,
        nearest=loop.reach.nearest,
        travel=loop.travel,
        travel_of_capture=path_length([centres[name] for name in loop.pool]),
        max_travel=loop.settings.max_travel,
        flown=tuple(vehicle.flown for vehicle in loop.vehicles.all),
        expected=loop.expected(),
        worst_rms=max((record.alignment.rms for record in loop.records), default=0.0),
        iterations=model.iterations,
        gaussians=len(model.gaussians),
        origin=loop.dataset.origin if loop.settings.scene.poses == "known" else (0.0, 0.0, 0.0),
        seconds=sum(record.seconds.total for record in loop.records),
    )


def open_outside(
    out: Path, folder: Path, colmap: Path | None, transforms: Path | None, monitor: Monitor
) -> Dataset:
    """Open the dataset in ``folder`` and pass on its warnings.

    Raises ``InvalidInputError`` when anything of it lies inside ``out``, and what ``open_dataset`` raises.
    """
    for given in (folder, colmap, transforms):
        if given is not None and given.resolve().is_relative_to(out.resolve()):
            raise InvalidInputError(
                f"{given} lies inside the output folder {out}.", hint="Choose an output folder outside."
            )
    dataset = open_dataset(folder, colmap, transforms)
    for warning in dataset.warnings:
        monitor.warn(warning)
    return dataset


@contextlib.contextmanager
def locked_output(out: Path) -> Iterator[None]:
    """Create the folder ``out`` and keep other writers out; an ``OSError`` becomes a ``StorageError``."""
    with storage_errors(out):
        out.mkdir(parents=True, exist_ok=True)
        with locked_folder(out):
            yield
