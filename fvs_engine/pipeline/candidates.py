"""Candidates of a ranking: from a candidates file or a transforms.json, or halfway between views."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, PositiveFloat, PositiveInt, ValidationError

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.json_input import read_json
from fvs_engine.geometry import (
    PinholeCamera,
    RigidTransform,
    angle_between,
    halfway_between_neighbours,
    matrix_from_quaternion,
    robust_umeyama,
)
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.validation import MAX_POSITION
from fvs_engine.images.names import match_names
from fvs_engine.pipeline.model import FolderModel
from fvs_engine.records import Record, first_error
from fvs_engine.scene.scene_model import usual_camera
from fvs_engine.sfm.colmap.transforms_json import read_transforms_poses
from fvs_engine.views import PinholeView

_UNIT_TOLERANCE = 1e-3
_MIN_SHARED_VIEWS = 3
_MAX_MISFIT = 0.25
"""RMS distance of shared views after alignment, in shares of their spread; plain GPS is below."""
_MAX_ATTITUDE_DEG = 20.0
"""Median angle between the attitudes of shared views: below that of any wrong axis."""

_Coordinate = Annotated[float, Field(ge=-MAX_POSITION, le=MAX_POSITION)]


class CameraInput(Record):
    """Intrinsics of a candidate, in px."""

    width: PositiveInt = Field(le=16384)
    height: PositiveInt = Field(le=16384)
    fx: PositiveFloat
    fy: PositiveFloat
    cx: float
    cy: float


class PoseInput(Record):
    """The pose model_from_camera of an OpenCV camera, as the service has it, but in the model frame only."""

    frame: Literal["model"] = "model"
    position: tuple[_Coordinate, _Coordinate, _Coordinate]
    orientation_wxyz: tuple[float, float, float, float]


class CandidateInput(Record):
    """A candidate by its pose; ``camera`` defaults to the one that most photographs have."""

    id: str = Field(min_length=1)
    pose: PoseInput
    camera: CameraInput | None = None


class ViewInput(Record):
    """A candidate at the pose of a registered image, with the most common camera."""

    id: str = Field(min_length=1)
    view: str


def read_candidates(
    path: Path,
    views: Sequence[PinholeView],
    aliases: Mapping[str, str],
    *,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    most: int | None = None,
) -> tuple[PinholeView, ...]:
    """Read a candidates file: a JSON list of ``CandidateInput`` and ``ViewInput``, or a transforms.json.

    ``origin`` [3] is subtracted from positions. ``aliases`` maps further names of views (those of the source
    folder) to the model's. Of a transforms.json the frames that are not views of the model become candidates;
    the views that both have align it with the model, unless they are too few, lie on a line or disagree with
    it.

    Raises ``InvalidInputError``, naming the file and the entry, for unknown or missing fields, numbers that
    are not finite, quaternions that are not unit, names that occur twice, unknown views, empty lists and more
    than ``most`` poses (None: any number).
    """
    document = read_json(path)
    _require_few(path, document, most)
    if isinstance(document, dict) and "frames" in document:
        candidates = _from_transforms(path, views, aliases)
    elif isinstance(document, list):
        by_name = {view.name: view for view in views}
        by_name |= {alias: by_name[name] for alias, name in aliases.items() if name in by_name}
        camera = usual_camera(views)
        candidates = [
            _parse(f"{path}, candidate {index}", entry, by_name, camera, np.asarray(origin))
            for index, entry in enumerate(document)
        ]
    else:
        raise InvalidInputError(
            f"{path} is neither a list of candidates nor a transforms.json.",
            hint='Write [{"id": …, "pose": {"position": [x, y, z], "orientation_wxyz": [w, x, y, z]}}, …].',
            path=path,
        )
    if not candidates:
        raise InvalidInputError(f"{path} holds no pose.", hint="List at least one.", path=path)
    seen: set[str] = set()
    for candidate in candidates:
        if candidate.name in seen:
            raise InvalidInputError(
                f"{path} holds two candidates called {candidate.name!r}.",
                hint="Give each its own name.",
                path=path,
            )
        seen.add(candidate.name)
    return tuple(candidates)


def _require_few(path: Path, document: Any, most: int | None) -> None:
    listed = document.get("frames") if isinstance(document, dict) else document
    if most is not None and isinstance(listed, list) and len(listed) > most:
        raise InvalidInputError(
            f"{path} holds {len(listed):,} poses; at most {most:,} can be planned with.",
            hint="Leave some out: several hundred spread over the scene are enough.",
            path=path,
        )


def candidates_of(
    model: FolderModel, path: Path | None, *, most: int | None = None
) -> tuple[PinholeView, ...]:
    """The candidates of a file; without one the held-out views, and poses between training views."""
    if path is not None:
        return read_candidates(path, model.registered, model.aliases, origin=model.origin, most=most)
    return candidates_at(model.held_out, model.camera) + candidates_between(model.views)


def candidates_between(views: Sequence[PinholeView]) -> tuple[PinholeView, ...]:
    """Candidates halfway between every view and the two nearest to it, each named after its pair."""
    camera = usual_camera(views)
    names = _short_names(views)
    between = halfway_between_neighbours([view.camera_from_model.inverse() for view in views])
    return tuple(
        PinholeView(f"{names[first]}–{names[second]}", camera, pose.inverse())
        for (first, second), pose in between.items()
    )


def candidates_at(views: Sequence[PinholeView], camera: PinholeCamera) -> tuple[PinholeView, ...]:
    """One candidate at the pose of each of ``views``, named after it.

    All have the same ``camera``: only scores of one image size can be compared.
    """
    return tuple(PinholeView(view.name, camera, view.camera_from_model) for view in views)


def _parse(
    where: str,
    entry: Any,
    by_name: Mapping[str, PinholeView],
    camera: PinholeCamera,
    origin: NDArray[np.float64],
) -> PinholeView:
    kind = ViewInput if isinstance(entry, dict) and "view" in entry else CandidateInput
    try:
        # Through JSON: only there does strict accept arrays for tuples.
        parsed = kind.model_validate_json(json.dumps(entry), strict=True)
    except ValidationError as error:
        raise InvalidInputError(f"{where}, {first_error(error, 'the entry')}.") from error
    if isinstance(parsed, ViewInput):
        view = by_name.get(parsed.view)
        if view is None:
            raise InvalidInputError(
                f"{where}: the model has no view {parsed.view!r}.", hint="`fvs info DIR --json` lists them."
            )
        return PinholeView(parsed.id, camera, view.camera_from_model)
    if parsed.camera is not None:
        camera = PinholeCamera(**parsed.camera.model_dump())
    quaternion = np.array(parsed.pose.orientation_wxyz)
    if abs(np.linalg.norm(quaternion) - 1.0) > _UNIT_TOLERANCE:
        raise InvalidInputError(
            f"{where}, pose.orientation_wxyz: its length is {np.linalg.norm(quaternion):.4g}, not 1.",
            hint="Give a unit quaternion, w first.",
        )
    model_from_camera = RigidTransform(matrix_from_quaternion(quaternion), parsed.pose.position - origin)
    return PinholeView(parsed.id, camera, model_from_camera.inverse())


def _from_transforms(
    path: Path, views: Sequence[PinholeView], aliases: Mapping[str, str]
) -> list[PinholeView]:
    frames = read_transforms_poses(path)
    by_name = {view.name: view for view in views}
    known = {name: name for name in by_name}
    known |= {alias: name for alias, name in aliases.items() if name in by_name}
    shared = match_names(frames, known).found
    if len(shared) < _MIN_SHARED_VIEWS:
        raise InvalidInputError(
            f"{path} shares {len(shared)} of its views with the model; to align it, "
            f"{_MIN_SHARED_VIEWS} are needed.",
            hint="Give a transforms.json that lists the photographs of the model too.",
            path=path,
        )
    source = np.stack([frames[name].translation for name in shared])
    target = np.stack([by_name[own].centre for own in shared.values()])
    alignment = robust_umeyama(source, target)
    misfit = alignment.rms > _MAX_MISFIT * centre_spread(target)
    if misfit or alignment.ill_conditioned:
        reason = "have other positions in it" if misfit else "lie on a line, which leaves a rotation open"
        raise InvalidInputError(
            f"{path} cannot be aligned with the model: the {len(shared)} views that both have {reason}.",
            hint="Give a file that was made from these photographs, or poses in the model frame.",
            path=path,
        )
    moved = {name: alignment.transform.move_camera(camera) for name, camera in frames.items()}
    turns = angle_between(
        np.stack([moved[name].rotation for name in shared]),
        np.stack([by_name[own].camera_from_model.inverse().rotation for own in shared.values()]),
    )
    turn_deg = float(np.degrees(np.median(turns)))
    if turn_deg > _MAX_ATTITUDE_DEG:
        raise InvalidInputError(
            f"{path} cannot be aligned with the model: the {len(shared)} views that both have agree in "
            f"position, but their attitudes differ by {turn_deg:.0f}° (median).",
            hint="A transforms.json has OpenGL axes (x right, y up, z backward), camera to world.",
            path=path,
        )
    if len(shared) == len(frames):
        raise InvalidInputError(
            f"All {len(frames)} frames of {path} are photographs of the model: none is left as a candidate.",
            hint="List poses that were not photographed as well.",
            path=path,
        )
    camera = usual_camera(views)
    return [PinholeView(name, camera, moved[name].inverse()) for name in frames if name not in shared]


def _short_names(views: Sequence[PinholeView]) -> list[str]:
    """Names without folder and suffix, or in full where that would make two of them one."""
    stems = [Path(view.name).stem for view in views]
    if len(set(stems)) == len(stems):
        return stems
    return [view.name for view in views]
