"""Candidates where no dataset has any: positions in a volume, clear of matter and aimed at the model."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera, RigidTransform, look_at_from_each
from fvs_engine.geometry.validation import finite_array
from fvs_engine.plan.clearance import FreeSpace
from fvs_engine.plan.distances import even_sample
from fvs_engine.plan.volumes import AnyVolume
from fvs_engine.views import PinholeView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_CANDIDATES = 100_000
_DRAWS = 10
"""Positions that are tried per requested candidate."""
_LEAST_DRAWS = 4_096
_MOST_SHOWN = 4_000
"""Maximum number of matter centres that are tested for being in the frame, sampled evenly."""
_LEAST_SHARE = 0.05
"""Size of the model in a candidate's frame, in shares of its longer side, below which it shows no details."""
_CHUNK = 1_000


@dataclass(frozen=True, eq=False)
class Aim:
    """What candidates look at: a ``target`` [3], the robust middle of the matter, or its nearest part.

    ``level``: towards it in direction only, with the viewing direction level.
    """

    target: ArrayLike | Literal["middle", "nearest"] = "middle"
    level: bool = False


def candidates_in(
    volume: AnyVolume,
    count: int,
    camera: PinholeCamera,
    *,
    up: ArrayLike,
    aim: Aim | None = None,
    space: FreeSpace | None = None,
    prefix: str | None = None,
) -> tuple[PinholeView, ...]:
    """Up to ``count`` views spread evenly over the free part of ``volume``, all in one frame.

    A candidate is in no no-fly zone, in reach, clear of matter, and has matter in its frame (where there is
    any), no farther away than where the model fills a twentieth of it; ``aim`` is by default the middle of
    the matter. Its name is ``prefix`` (by default the kind of the volume) and its number among the positions
    of the volume: the same position keeps its name when the model, the zones or ``count`` change. Fewer are
    returned where ten times as many positions do not give enough.

    Raises ``InvalidInputError`` for a count that is not in 1 to ``MOST_CANDIDATES``, without matter and
    target, and where no position is left: with what rules them out.
    """
    aim, space = aim or Aim(), space or FreeSpace()
    if not 1 <= count <= MOST_CANDIDATES:
        raise InvalidInputError(
            f"Between 1 and {MOST_CANDIDATES:,} candidates can be asked for, not {count:,}.",
            hint="Several hundred spread over the volume are enough for a plan.",
        )
    most = max(_LEAST_DRAWS, _DRAWS * count)
    stages = _Stages(aim, space, camera, finite_array("up", up, (3,)))
    found: list[PinholeView] = []
    drawn = 0
    for positions in volume.stream():
        positions = positions[: most - drawn]
        numbers, poses = stages.kept(positions, count - len(found))
        found += [
            PinholeView(f"{prefix or volume.kind}-{drawn + number:05d}", camera, pose.inverse())
            for number, pose in zip(numbers, poses, strict=True)
        ]
        drawn += len(positions)
        if len(found) >= count or drawn >= most:
            break
    if not found:
        raise stages.nothing(drawn)
    return tuple(found)


class _Stages:
    """Successive tests of positions, and the number that passed each."""

    def __init__(self, aim: Aim, space: FreeSpace, camera: PinholeCamera, up: Array) -> None:
        self._aim, self._space, self._camera = aim, space, camera
        if not up.any():
            raise InvalidInputError("The up vector is zero.")
        self._up = up / np.linalg.norm(up)
        self._target: Array | None = None
        if not isinstance(aim.target, str):
            self._target = finite_array("target", aim.target, (3,))
        elif aim.target == "middle":
            self._target = space.matter.middle
        elif aim.target != "nearest":
            raise InvalidInputError("Candidates aim at a target, at 'middle' or at 'nearest'.")
        self._shown = space.matter.centres[even_sample(len(space.matter), _MOST_SHOWN)]
        self._farthest = self._distance_of_details()
        self.left = {"no-fly": 0, "reach": 0, "matter": 0}

    def kept(self, positions: Array, most: int) -> tuple[list[int], list[RigidTransform]]:
        """Which positions make a candidate, the first ``most``, and their model_from_camera."""
        numbers = np.arange(len(positions))
        for stage, test in (
            ("no-fly", self._space.allowed),
            ("reach", self._space.within_reach),
            ("matter", self._space.clear),
        ):
            numbers = numbers[test(positions[numbers])]
            self.left[stage] += len(numbers)
        kept: list[int] = []
        poses: list[RigidTransform] = []
        for start in range(0, len(numbers), _CHUNK):
            if len(kept) >= most:
                break
            some = numbers[start : start + _CHUNK]
            for number, pose in zip(some.tolist(), self._poses(positions[some]), strict=True):
                if pose is not None and len(kept) < most:
                    kept.append(number)
                    poses.append(pose)
        return kept, poses

    def nothing(self, drawn: int) -> InvalidInputError:
        """The error that says why no candidate is left of ``drawn`` positions."""
        if not drawn:
            return InvalidInputError(
                "No position was found in the volume: it is too thin beside its extent.",
                hint="Give a volume with more room.",
            )
        if not self.left["no-fly"]:
            return InvalidInputError(
                "The no-fly zones cover the whole volume.", hint="Give a smaller zone, or another volume."
            )
        if not self.left["reach"]:
            return InvalidInputError(
                "What no-fly zones leave of the volume is out of reach of the start.",
                hint="Give a longer reach, or a volume nearer to the start.",
            )
        if not self.left["matter"]:
            return InvalidInputError(
                "All of the volume that may be flown in is inside a solid part of the model, or within "
                "the safety distance of one.",
                hint="Give a shorter safety distance, or a volume farther from the model.",
            )
        return InvalidInputError(
            "No candidate in the volume would have the model in its frame, large enough to show anything.",
            hint="Aim at the model instead of level, or give a volume or a target nearer to it.",
        )

    def _distance_of_details(self) -> float:
        """The distance at which the model, without its farthest half, fills a twentieth of the frame."""
        if not len(self._shown):
            return np.inf
        radius = float(np.median(np.linalg.norm(self._shown - self._space.matter.middle, axis=1)))
        longer = max(self._camera.width / self._camera.fx, self._camera.height / self._camera.fy)
        return 2.0 * radius / (_LEAST_SHARE * longer) if radius > 0.0 else np.inf

    def _poses(self, positions: Array) -> list[RigidTransform | None]:
        """The model_from_camera of each position; None where it sees nothing or has no viewing direction."""
        if self._target is None:
            targets = self._space.matter.nearest(positions)
        else:
            targets = np.broadcast_to(self._target, positions.shape)
        if self._aim.level:
            across = targets - positions
            level = across - (across @ self._up)[:, None] * self._up
            # Straight above its target a level camera has no direction: rounding would choose one.
            steep = np.linalg.norm(level, axis=1) <= 1e-6 * np.linalg.norm(across, axis=1)
            targets = positions + np.where(steep[:, None], 0.0, level)
        poses = look_at_from_each(positions, targets, self._up)
        return [pose if pose is not None and self._sees_some(pose) else None for pose in poses]

    def _sees_some(self, pose: RigidTransform) -> bool:
        if not len(self._shown):
            return True
        camera, (x, y, z) = self._camera, pose.inverse().apply(self._shown).T
        u, v = camera.fx * x + camera.cx * z, camera.fy * y + camera.cy * z
        inside = (z > 0.0) & (u >= 0.0) & (u <= camera.width * z) & (v >= 0.0) & (v <= camera.height * z)
        return bool(inside.any() and z[inside].min() <= self._farthest)
