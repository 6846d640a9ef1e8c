"""Views in a world frame as the file of a mission: no database, no transport."""

from collections.abc import Sequence

from fvs_schema.error_codes import FieldError
from fvs_schema.missions import Autopilot, MissionFile, MissionOptions, MissionView
from fvs_schema.poses import FramePose, VehiclePose
from fvs_schema.scenes import AltitudeDatum, Origin
from fvs_schema.snapshots import PinholeIntrinsics
from fvs_schema.terrain import Terrain
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.altitudes import Altitudes
from fvs_service.missions.camera_poses import CameraPoses
from fvs_service.missions.composition import MOST_NAMED, Composer, Leg, Violation
from fvs_service.missions.flight import Mission, Waypoint
from fvs_service.missions.formats.registry import WRITERS, MissionWriter, PoseWriter
from fvs_service.missions.gimbal import levelled
from fvs_service.missions.ground import Ground
from fvs_service.missions.home import given_home_m, require_plausible, require_related
from fvs_service.scenes.poses import WorldFrame, require_on_earth

_OF_EARTH = (
    *("home_latitude_deg", "home_altitude_m", "home_above_takeoff_m", "transit_height_m"),
    *("lowest_height_m", "highest_height_m", "geofence", "altitude_datum", "geoid_height_m"),
    "battery_s",
)
"""Options that mean nothing without georeference."""


def write_mission(
    name: str,
    frame: WorldFrame,
    views: Sequence[MissionView],
    via_home: Sequence[FramePose | VehiclePose],
    options: MissionOptions,
    ground_up_m: float | None,
    camera: PinholeIntrinsics | None = None,
    terrain: Terrain | None = None,
    model_ground: Terrain | None = None,
) -> MissionFile:
    """The views, in their order, as a file; ``ground_up_m`` is where the ground is on the world's up axis.

    ``camera`` is that of the scene's images; a ``terrain`` is the ground instead. With ``model_ground``, the
    ground by the model's points, the altitude of home is compared. Of a mission that is cut to a battery this
    is the part that the options name. Raises ``InvalidRequestError`` for a format that needs a georeferenced
    scene without one, and for what cannot be flown or written.
    """
    if not views:
        raise InvalidRequestError(
            "There is no view to fly to.", hint="Give views, or a ranking that has ranked candidates."
        )
    writer = WRITERS[options.format]
    ground = ground_up_m if terrain is None else terrain
    if options.above_ground:
        _require_above_ground(writer, options, terrain)
    parts, length_m, duration_s = 1, None, None
    if isinstance(writer, MissionWriter):
        missions, violations = _composed(name, frame, views, via_home, options, ground, model_ground, writer)
        mission, parts = _part(missions, options), len(missions)
        name, content, count = mission.name, writer.write(mission), len(mission.views)
        length_m, duration_s = mission.length_m, mission.duration_s
    else:
        violations = ()
        if frame.georeferenced:
            missions, violations = _composed(name, frame, views, via_home, options, ground, model_ground)
            mission, parts = _part(missions, options), len(missions)
            name, flown = mission.name, {waypoint.name for waypoint in mission.views}
            views = [view for view in views if view.id in flown]
        else:
            _require_no_earth(frame, options, writer, terrain)
        count = len(views)
        cameras = frame.world_from_cameras([view.pose for view in views])
        content = writer.write(CameraPoses(tuple(view.id for view in views), cameras, camera))
    return MissionFile(
        name=f"{name}{writer.suffix}",
        media_type=writer.media_type,
        content=content,
        parts=parts,
        views=count,
        length_m=length_m,
        duration_s=duration_s,
        left_out=tuple(violation.view for violation in violations),
        reasons=tuple(violation.reason for violation in violations[:MOST_NAMED]),
    )


def _composed(
    name: str,
    frame: WorldFrame,
    views: Sequence[MissionView],
    via_home: Sequence[FramePose | VehiclePose],
    options: MissionOptions,
    ground: Terrain | float | None,
    model_ground: Terrain | None,
    writer: MissionWriter | None = None,
) -> tuple[tuple[Mission, ...], tuple[Violation, ...]]:
    """The parts of the mission, and what was left out of it; without a ``writer`` in any datum."""
    origin = _origin_of(frame)
    home_m = given_home_m(options, frame.alignment.takeoff_altitude_m)
    under: Ground | float | None = None
    if isinstance(ground, Terrain):
        under = Ground(ground, options, origin.altitude_datum, home_m)
        home_m = under.home_m
    elif ground is not None:
        under = origin.altitude_m + ground
    altitudes = Altitudes.of(origin.altitude_datum, home_m, options.geoid_height_m)
    require_plausible(options, altitudes.home_m, frame.alignment, model_ground)
    possible = frozenset(AltitudeDatum) if writer is None else writer.datums
    datum = altitudes.choose(options.altitude_datum, possible, "the file" if writer is None else writer.name)
    require_related(options, datum, frame.alignment)
    at_views = _waypoints(frame, [(view.id, view.pose) for view in views])
    if options.format.of_gimbals:
        at_views = tuple(map(levelled, at_views))
    legs = [Leg(at_view, _passed(frame, view.via)) for view, at_view in zip(views, at_views, strict=True)]
    follows = options.above_ground and writer is not None and writer.above_ground == "flown"
    composer = Composer(options, altitudes, under, follows=follows)
    return composer.missions(name, legs, _passed(frame, via_home), datum)


def _part(missions: Sequence[Mission], options: MissionOptions) -> Mission:
    """The part that is asked for; raises ``InvalidRequestError`` when there are fewer."""
    count = len(missions)
    if options.part > count:
        wrong = FieldError(
            "part", f"the mission has {count} {'part' if count == 1 else 'parts'}, counted from 1"
        )
        hint = "Name one of them."
        if options.battery_s is None:
            hint = "Give battery_s, to which the mission is cut into parts; or leave part out."
        raise InvalidRequestError(f"{wrong.field}: {wrong.message}.", hint=hint, errors=(wrong,))
    return missions[options.part - 1]


def _origin_of(frame: WorldFrame) -> Origin:
    """The origin of the world; raises ``InvalidRequestError`` when the scene is not georeferenced."""
    if frame.georeferenced:
        return frame.require_origin()
    raise InvalidRequestError(
        "The scene is not georeferenced: where on Earth its views are is not known, so they cannot be flown.",
        hint="Send images with GPS to a scene with an automatic or an enu world: a local world is nowhere on "
        "Earth. The format nerfstudio needs no georeference.",
    )


def _require_above_ground(
    writer: MissionWriter | PoseWriter, options: MissionOptions, terrain: Terrain | None
) -> None:
    """Raise ``InvalidRequestError`` where a file cannot have altitudes above the ground."""
    wrong = None
    if terrain is None:
        wrong = "a terrain is missing", "Send a terrain with the views (POST /v1/scenes/{scene_id}/missions)."
    elif not isinstance(writer, MissionWriter) or writer.above_ground == "never":
        wrong = (
            f"{writer.name} has no altitudes above the ground",
            "The terrain is in its altitudes: leave it out.",
        )
    elif writer.above_ground == "flown" and options.autopilot is Autopilot.PX4:
        wrong = "PX4 flies no missions above the ground", "The terrain is in its altitudes: leave it out."
    if wrong is not None:
        raise InvalidRequestError(
            f"above_ground: {wrong[0]}.", hint=wrong[1], errors=[FieldError("above_ground", wrong[0])]
        )


def _require_no_earth(
    frame: WorldFrame, options: MissionOptions, writer: PoseWriter, terrain: Terrain | None
) -> None:
    """Raise ``InvalidRequestError`` for what a scene without georeference cannot have."""
    if writer.metric and not frame.aligned:
        raise InvalidRequestError(
            f"The scene has no metres, which {writer.name} needs: its world is the model frame.",
            hint="Send images with GPS, or with positions in a local world.",
        )
    given = [name for name in _OF_EARTH if getattr(options, name) is not None]
    for name in given if terrain is None else ("terrain", *given):
        raise InvalidRequestError(
            f"The scene is not georeferenced, so {name} has no meaning in it.",
            hint=f"Leave it out: {writer.name} has only the poses, as they are in the world frame.",
            errors=[FieldError(name, "the scene is not georeferenced")],
        )


def _passed(frame: WorldFrame, poses: Sequence[FramePose | VehiclePose]) -> tuple[Waypoint, ...]:
    """Poses as waypoints where nothing is photographed."""
    return _waypoints(frame, [(None, pose) for pose in poses]) if poses else ()


def _waypoints(
    frame: WorldFrame, named: Sequence[tuple[str | None, FramePose | VehiclePose]]
) -> tuple[Waypoint, ...]:
    """Poses as waypoints, with the altitudes of the scene."""
    cameras = frame.world_from_cameras([pose for _, pose in named])
    for (name, _), camera in zip(named, cameras, strict=True):
        require_on_earth({name or "a waypoint": camera})
    return tuple(
        Waypoint(
            name=name,
            latitude_deg=pose.latitude_deg,
            longitude_deg=pose.longitude_deg,
            altitude_m=pose.altitude_m,
            yaw_deg=pose.yaw_deg,
            pitch_deg=pose.pitch_deg,
            roll_deg=pose.roll_deg,
        )
        for (name, _), pose in zip(named, frame.poses(cameras, "geodetic"), strict=True)
        if isinstance(pose, VehiclePose)
    )
