"""Missions: the views of a ranking, of a plan or of one's own, as files for vehicles."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

from fvs_schema.candidates import Candidate
from fvs_schema.error_codes import FieldError
from fvs_schema.missions import MissionFile, MissionOptions, MissionRequest, MissionView, PlanMissionOptions
from fvs_schema.poses import FramePose, Pose, frame_of
from fvs_schema.scenes import Alignment, AlignmentStatus
from fvs_schema.snapshots import PinholeIntrinsics
from fvs_schema.terrain import Terrain, TerrainOfPoints
from fvs_service.errors import InvalidRequestError, NotFoundError
from fvs_service.images.repository import in_order_of_capture
from fvs_service.missions.composition import MOST_NAMED
from fvs_service.missions.writing import write_mission
from fvs_service.plans.service import Plans
from fvs_service.principal import Principal, Scope
from fvs_service.rankings.service import Rankings
from fvs_service.rankings.snapshot_frames import SnapshotFrames
from fvs_service.scenes.poses import WorldFrame
from fvs_service.scenes.repository import scene_head_of
from fvs_service.storage.database import Database

ReadRequest: TypeAlias = Callable[[], MissionRequest]
"""Reads a request; it is called in a thread, after the permission check."""


class Missions:
    """Writes missions. Nothing is stored: the same views give the same bytes again."""

    def __init__(self, database: Database, frames: SnapshotFrames, rankings: Rankings, plans: Plans) -> None:
        self._database, self._frames = database, frames
        self._rankings, self._plans = rankings, plans

    def of_ranking(self, principal: Principal, ranking_id: str, options: MissionOptions) -> MissionFile:
        """The ranked candidates of a ranking, in its order.

        Raises ``NotFoundError``, and ``InvalidRequestError`` for what cannot be flown or written.
        """
        ranking = self._rankings.get(principal, ranking_id)
        ranked = [item for item in ranking.candidates if item.rank is not None]
        views = [MissionView(id=item.id, pose=item.pose) for item in ranked[: options.first]]
        frame = WorldFrame(ranking.origin, ranking.alignment)
        _require_sure_axes(ranking.alignment, given=_given(ranking.request.candidates))
        lowest, camera, ground = self._surroundings(ranking.snapshot_id)
        return write_mission(ranking.id, frame, views, (), options, lowest, camera, model_ground=ground)

    def of_plan(self, principal: Principal, plan_id: str, options: PlanMissionOptions) -> MissionFile:
        """The stops of one vehicle of a plan; raises as ``of_ranking``."""
        plan = self._plans.get(principal, plan_id)
        if options.vehicle > len(plan.tours):
            vehicles = "1 vehicle" if len(plan.tours) == 1 else f"{len(plan.tours)} vehicles"
            wrong = FieldError("vehicle", f"the plan is for {vehicles}, counted from 1")
            raise InvalidRequestError(
                f"{wrong.field}: {wrong.message}.", hint="Name one of them.", errors=(wrong,)
            )
        tour = plan.tours[options.vehicle - 1]
        views = [MissionView(id=stop.id, pose=stop.pose, via=stop.via) for stop in tour.stops]
        frame = WorldFrame(plan.origin, plan.alignment)
        _require_sure_axes(plan.alignment, given=_given(plan.request.candidates))
        flown = views[: options.first]
        lowest, camera, ground = self._surroundings(plan.snapshot_id)
        via_home = _way_home(tour.via_home, flown, views)
        return write_mission(plan.id, frame, flown, via_home, options, lowest, camera, model_ground=ground)

    def of_views(
        self, principal: Principal, scene_id: str, read: ReadRequest, options: MissionOptions
    ) -> MissionFile:
        """The views of a request, or the photographs that it names; raises as ``of_ranking``."""
        principal.require(Scope.READ, scene_id)
        with self._database.querying() as reader:
            scene = scene_head_of(reader, principal, scene_id)
        request = read()
        snapshot = self._frames.snapshot(principal, scene, request.snapshot_id)
        frame = self._frames.frame(snapshot.id, scene.origin)
        wanted = request.views or self._photographed(scene.id, snapshot.id, request)
        poses = [view.pose for view in wanted]
        _require_sure_axes(snapshot.alignment, given=all(frame_of(pose) != "model" for pose in poses))
        views = wanted[: options.first]
        via_home = _way_home(request.via_home, views, wanted)
        lowest, camera, ground = self._surroundings(snapshot.id)
        terrain = request.terrain
        if isinstance(terrain, TerrainOfPoints):
            terrain = self._frames.require_ground(snapshot.id)
        return write_mission(scene.id, frame, views, via_home, options, lowest, camera, terrain, ground)

    def _photographed(
        self, scene_id: str, snapshot_id: str, request: MissionRequest
    ) -> tuple[MissionView, ...]:
        """The views of a snapshot's images that a request names."""
        taken = {view.image: view for view in self._frames.cameras(snapshot_id).views}
        if request.all_images:
            with self._database.reading() as session:
                order = in_order_of_capture(session, scene_id)
            present = [digest for digest in order if digest in taken]
            wanted = [*present, *(digest for digest in taken if digest not in set(present))]
        else:
            wanted = list(request.images or ())
        if missing := [digest for digest in wanted if digest not in taken]:
            raise InvalidRequestError(
                f"{len(missing)} of the images have no pose in the snapshot. The first is {missing[0]}.",
                hint="Leave them out, or name a snapshot in which they are registered.",
                errors=[FieldError("images", f"{digest} has no pose") for digest in missing[:MOST_NAMED]],
            )
        return tuple(
            MissionView(
                id=digest,
                pose=FramePose(
                    frame="model",
                    position=taken[digest].position,
                    orientation_wxyz=taken[digest].orientation_wxyz,
                ),
            )
            for digest in wanted
        )

    def _surroundings(
        self, snapshot_id: str
    ) -> tuple[float | None, PinholeIntrinsics | None, Terrain | None]:
        """The height of the model's lowest point in the world frame, the camera of its images, its ground.

        None when the snapshot was deleted.
        """
        try:
            lowest, cameras = self._frames.geometry(snapshot_id).lower[2], self._frames.cameras(snapshot_id)
        except NotFoundError:
            return None, None, None
        return float(lowest), cameras.camera, self._frames.ground(snapshot_id)


def _way_home(
    via: Sequence[Pose], flown: Sequence[MissionView], views: Sequence[MissionView]
) -> Sequence[Pose]:
    """The way home from the last of ``views``, if it is flown to."""
    return via if len(flown) == len(views) else ()


def _given(given: Sequence[Candidate] | None) -> bool:
    """Whether candidates were listed, in the world frame or with geodetic poses."""
    return given is not None and all(frame_of(item.pose) != "model" for item in given)


def _require_sure_axes(alignment: Alignment, *, given: bool) -> None:
    """Raise ``InvalidRequestError`` for poses that depend on a rotation which is not known."""
    if alignment.status is AlignmentStatus.ILL_CONDITIONED and not given:
        raise InvalidRequestError(
            "The photographs lie on a line, so the model may be turned about it by tens of degrees: a "
            "mission could lead into the ground.",
            hint="Fly a second line beside the first, or send yaw, pitch and roll with every image; or give "
            "candidates with geodetic poses.",
        )
