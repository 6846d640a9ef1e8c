"""Plan of the views to photograph next, for a reconstruction in an output folder."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from pydantic import AwareDatetime, Field

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.record import write_record
from fvs_engine.files.storage import storage_errors
from fvs_engine.geometry import quaternion_from_matrix
from fvs_engine.pipeline.candidates import candidates_of, read_candidates
from fvs_engine.pipeline.model import TrainedModel, open_model
from fvs_engine.pipeline.plan_picture import draw_plan
from fvs_engine.plan.forecast import Seen
from fvs_engine.plan.mission import plan_mission
from fvs_engine.plan.plan_records import Mission
from fvs_engine.plan.targets import Targets
from fvs_engine.plan.tours import Budget
from fvs_engine.records import Record
from fvs_engine.scene.observations import read_observations
from fvs_engine.views import PinholeView

Position = tuple[float, float, float]


class PlannedPose(Record):
    """The pose of a planned view, model_from_camera."""

    name: str
    position: Position
    orientation_wxyz: tuple[float, float, float, float]


class PlanResult(Record):
    """``plan.json``: the mission, the poses of its views by name, and the names of the targets."""

    version: int = 1
    created: AwareDatetime = Field(default_factory=lambda: datetime.now(UTC))
    summary: str
    mission: Mission
    poses: tuple[PlannedPose, ...]
    targets: tuple[str, ...]


def plan_next_views(
    root: Path,
    budget: Budget,
    *,
    candidates_file: Path | None = None,
    targets_file: Path | None = None,
    starts: Sequence[Position] = (),
    vehicles: int = 1,
    out: Path | None = None,
) -> tuple[PlanResult, Path]:
    """Plan views among the candidates of a file; write plan.json and plan.png.

    Without a file the candidates are those of ``rank_candidates``. The targets are the poses of a file in
    the same format, by default all views of the model and the candidates. Vehicles are at ``starts``, in the
    model frame, or as many as ``vehicles`` at the last photograph. The held-out views calibrate the forecast.

    Returns the plan and the folder written: ``out``, or ``plan/`` in ``root``. Raises what ``open_model``,
    ``read_candidates`` and ``plan_mission`` raise, and ``StorageError``.
    """
    model = open_model(root)
    later = candidates_of(model, candidates_file)
    served = read_candidates(targets_file, model.views, model.aliases) if targets_file else ()
    if not served:
        served = (*model.views, *(view for view in later if view not in model.views))
    if not all(np.isfinite(start).all() for start in starts):
        raise InvalidInputError("A start must be three finite numbers.", hint="Give --start X,Y,Z.")
    observations = read_observations(model.workspace.undistorted / "sparse") if _estimated(model) else None
    targets = Targets(model.training_views, later, served, observations)
    places = [np.array(start) for start in starts] or [model.training_views[-1].centre] * vehicles
    mission = plan_mission(targets, budget, places, _seen(model))
    poses = {view.name: view for view in later}
    planned = [stop.name for tour in mission.tours for stop in tour.stops]
    result = PlanResult(
        summary=mission.sentence("units"),
        mission=mission,
        poses=tuple(_pose(poses[name]) for name in planned),
        targets=tuple(view.name for view in served),
    )
    folder = out or model.workspace.plan
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_record(folder / "plan.json", result)
    draw_plan(folder / "plan.png", mission, model.training_views, served, poses, title=result.summary)
    return result, folder


def _estimated(model: TrainedModel) -> bool:
    """Whether a new photograph has to be registered, as those of the model were."""
    return model.manifest.cameras is not None and model.manifest.cameras.source == "photographs"


def _seen(model: TrainedModel) -> list[Seen]:
    """The held-out views, which the model was not trained on."""
    metrics = model.workspace.read_metrics()
    if metrics is None or not metrics.views or not model.held_out_views:
        return []
    targets = Targets(model.training_views, model.held_out_views, model.views)
    variances = dict(zip(targets.index, targets.own_variances().tolist(), strict=True))
    return [Seen(variances[view.name], view.psnr_db) for view in metrics.views if view.name in variances]


def _pose(view: PinholeView) -> PlannedPose:
    model_from_camera = view.camera_from_model.inverse()
    return PlannedPose(
        name=view.name,
        position=tuple(model_from_camera.translation.tolist()),
        orientation_wxyz=tuple(quaternion_from_matrix(model_from_camera.rotation).tolist()),
    )
