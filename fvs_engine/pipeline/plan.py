"""Plan of the views to photograph next, for a reconstruction in an output folder."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from pydantic import AwareDatetime, Field

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.json_input import read_json
from fvs_engine.files.record import write_record
from fvs_engine.files.storage import storage_errors
from fvs_engine.geometry import SimilarityTransform, quaternion_from_matrix
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.candidates import candidates_of
from fvs_engine.pipeline.ground import above_ground, ground_check
from fvs_engine.pipeline.manifest import Position
from fvs_engine.pipeline.model import FolderModel, open_model
from fvs_engine.pipeline.plan_picture import draw_plan
from fvs_engine.plan.clearance import FreeSpace
from fvs_engine.plan.distances import view_points
from fvs_engine.plan.flight import MOST_PLACES
from fvs_engine.plan.forecast import Seen
from fvs_engine.plan.generate import MOST_CANDIDATES, Aim, candidates_in
from fvs_engine.plan.kriging import noise_of, variances
from fvs_engine.plan.plan import considered
from fvs_engine.plan.plan_records import Plan, VehicleTour
from fvs_engine.plan.plan_warnings import few_registrable, ground_findings
from fvs_engine.plan.tours import Budget
from fvs_engine.plan.volumes import AnyVolume, volume_from_json
from fvs_engine.records import Record
from fvs_engine.views import PinholeView
from fvs_schema.findings import Finding, FindingCode


@dataclass(frozen=True)
class Flight:
    """Constraints of vehicles: ``safety``, their distance from matter, and ``no_fly``, files of volumes.

    ``volume``: a file with a volume in which ``count`` candidates are generated, which look where ``aim``
    says. All in units of the model, positions in the coordinates of imported cameras.
    """

    safety: float = 0.0
    no_fly: tuple[Path, ...] = ()
    volume: Path | None = None
    count: int = 300
    aim: Aim = field(default_factory=Aim)


class PlannedPose(Record):
    """The pose of a planned view, model_from_camera."""

    name: str
    position: Position
    orientation_wxyz: tuple[float, float, float, float]


class PlanResult(Record):
    """``plan.json``: the plan, and the poses of its views."""

    version: int = 1
    created: AwareDatetime = Field(default_factory=lambda: datetime.now(UTC))
    summary: str
    plan: Plan
    poses: tuple[PlannedPose, ...]


def plan_next_views(
    root: Path,
    budget: Budget,
    *,
    candidates_file: Path | None = None,
    targets_file: Path | None = None,
    starts: Sequence[Position] = (),
    vehicles: int = 1,
    flight: Flight | None = None,
    terrain: str | None = None,
    out: Path | None = None,
    monitor: Monitor | None = None,
) -> tuple[PlanResult, Path]:
    """Plan views among the candidates of a file; write plan.json and plan.png.

    Without a file the candidates are those of ``rank_candidates``. The targets are the poses of a file in
    the same format, by default all views of the model and the candidates. Vehicles are at ``starts``, in the
    model frame, or as many as ``vehicles`` at the last photograph. The held-out views calibrate the forecast.

    Of very many candidates an even share is considered (``considered``), with a warning.

    With a ``flight`` candidates may come from a volume, and vehicles keep clear of matter and no-fly zones.
    Candidates under the ground of a ``terrain``, see ``ground_check``, are not planned; a warning names them.

    Returns the plan and the folder written: ``out``, or ``plan/`` in ``root``. Raises what ``open_model``,
    ``read_candidates``, ``ground_check`` and ``make_plan`` raise, and ``StorageError``.
    """
    monitor = monitor or Monitor()
    model = open_model(root)
    space = None
    if flight is not None:
        space = model.space(flight.safety, tuple(_volume(model, file) for file in flight.no_fly), monitor)
    found = _candidates(model, candidates_file, flight, space, monitor)
    ground = ground_check(model, found, terrain)
    candidates = above_ground(found, ground)
    targets: tuple[PinholeView, ...] = ()
    if targets_file:
        targets = candidates_of(model, targets_file, most=MOST_CANDIDATES)
    places = [np.array(start) - model.origin for start in starts] or [model.views[-1].centre] * vehicles
    given, candidates = len(candidates), considered(candidates, budget.views, MOST_PLACES - len(places))
    if len(candidates) < given:
        code = FindingCode.CANDIDATES_DRAWN
        monitor.warn(Finding.of(code, considered=len(candidates), of=given))
    if not all(np.isfinite(start).all() for start in starts):
        raise InvalidInputError("A start must be three finite numbers.", hint="Give --start X,Y,Z.")
    plan = model.plan(
        candidates,
        budget,
        places,
        lambda spread: _seen(model, spread),
        targets=targets,
        space=space,
        monitor=monitor,
    )
    plan = plan.model_copy(update={"warnings": (*ground_findings(ground), *plan.warnings)})
    for finding in (*few_registrable(plan.registrable, len(candidates)), *plan.warnings):
        monitor.warn(finding)
    by_name = {view.name: view for view in candidates}
    result = PlanResult(
        summary=plan.sentence("units"),
        plan=plan.model_copy(update={"tours": tuple(_in_user_frame(tour, model) for tour in plan.tours)}),
        poses=tuple(_pose(by_name[stop.name], model) for tour in plan.tours for stop in tour.stops),
    )
    folder = out or model.workspace.plan
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_record(folder / "plan.json", result)
    of_model = model.registered
    served = targets or (*of_model, *(by_name[name] for name in plan.targets[len(of_model) :]))
    draw_plan(folder / "plan.png", plan, model.views, served, by_name, title=result.summary)
    return result, folder


def _candidates(
    model: FolderModel, file: Path | None, flight: Flight | None, space: FreeSpace | None, monitor: Monitor
) -> tuple[PinholeView, ...]:
    """The candidates of a file, or those of the flight's volume."""
    if flight is None or space is None or flight.volume is None:
        return candidates_of(model, file, most=MOST_CANDIDATES)
    volume, aim = _volume(model, flight.volume), flight.aim
    if not isinstance(aim.target, str):
        aim = replace(aim, target=np.asarray(aim.target) - model.origin)
    found = candidates_in(volume, flight.count, model.camera, up=model.up, aim=aim, space=space)
    if len(found) < flight.count:
        monitor.warn(Finding.of(FindingCode.FEWER_CANDIDATES, made=len(found), wanted=flight.count))
    return found


def _volume(model: FolderModel, file: Path) -> AnyVolume:
    """The volume in a file, in the model frame."""
    volume = read_volume(file)
    return volume.moved(SimilarityTransform(1.0, np.eye(3), -model.origin)) if model.origin.any() else volume


def read_volume(path: Path) -> AnyVolume:
    """The volume in a JSON file; raises ``InvalidInputError``, naming the file."""
    document = read_json(path)  # names the file in its errors
    try:
        return volume_from_json(json.dumps(document))
    except InvalidInputError as error:
        raise InvalidInputError(f"{path}: {error.message}", hint=error.hint, path=path) from error


def _seen(model: FolderModel, scale: float) -> list[Seen]:
    """The held-out views, which the model was not trained on; ``scale``: the spread of the plan's targets."""
    metrics = model.workspace.read_metrics()
    if metrics is None or not metrics.views or not model.held_out:
        return []
    held_out, visited = (view_points(views, scale) for views in (model.held_out, model.views))
    names = [view.name for view in model.held_out]
    known = dict(zip(names, variances(held_out, visited, noise_of(model.views)).tolist(), strict=True))
    return [Seen(known[view.name], view.psnr_db) for view in metrics.views if view.name in known]


def _pose(view: PinholeView, model: FolderModel) -> PlannedPose:
    model_from_camera = view.camera_from_model.inverse()
    return PlannedPose(
        name=view.name,
        position=model.in_user_frame(tuple(model_from_camera.translation)),
        orientation_wxyz=tuple(quaternion_from_matrix(model_from_camera.rotation).tolist()),
    )


def _in_user_frame(tour: VehicleTour, model: FolderModel) -> VehicleTour:
    """The tour in the coordinates of imported cameras."""
    moved = model.in_user_frame
    stops = (stop.model_copy(update={"via": tuple(map(moved, stop.via))}) for stop in tour.stops)
    via_home = tuple(map(moved, tour.via_home))
    return tour.model_copy(update={"start": moved(tour.start), "stops": tuple(stops), "via_home": via_home})
