"""Replay worlds: a trained model of real photographs, in which a simulated vehicle flies."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.files.storage import storage_errors
from fvs_engine.geometry import PinholeCamera, RigidTransform, SimilarityTransform, level_axes
from fvs_engine.geometry.geodetic import GeodeticPosition, attitude_of, geodetic_from_enu
from fvs_engine.lab.simulate.camera import GAMMA
from fvs_engine.pipeline.model import open_model
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.render import render_color
from fvs_engine.views import PinholeView

Array = NDArray[np.float64]

_PARALLEL = 0.02
"""Share of the largest singular value below which viewing directions do not cross in a direction."""
_STILL = 1e-6
"""Median distance, in shares of the coordinates, that rounding can make."""
_FEWEST = 3


@dataclass(frozen=True)
class ReplayPlace:
    """Where the photographs of a model are put: in the air around a vehicle's home.

    ``distance_m`` is the median level distance of their cameras from home, below the point that they look at,
    and ``lowest_m`` the height of the lowest one. Raises ``InvalidInputError`` unless both are above zero.
    """

    distance_m: float = 30.0
    lowest_m: float = 6.0

    def __post_init__(self) -> None:
        if self.distance_m <= 0 or self.lowest_m <= 0:
            raise InvalidInputError("The cameras of a replay world are off home, and above ground.")


class ReplayScenery:
    """A trained model, rendered from anywhere; ``views`` are those of its photographs, in ENU metres.

    ``up`` is what is up in most photographs, so yaw is arbitrary: north is a level direction of the model.
    The lens has no distortion. ``target_height_m`` is how high above home the point is that most look at.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        views: Sequence[PinholeView],
        camera: PinholeCamera,
        place: ReplayPlace | None = None,
        backend: str = "auto",
    ) -> None:
        if len(views) < _FEWEST:
            raise InvalidInputError(f"A replay world needs a model of {_FEWEST} photographs or more.")
        self._world_from_model, self.target_height_m = _placed(views, place or ReplayPlace())
        self.views = tuple(
            PinholeView(
                view.name,
                view.camera,
                self._world_from_model.move_camera(view.camera_from_model.inverse()).inverse(),
            )
            for view in views
        )
        self.camera = camera
        self._rasterizer = create_rasterizer(backend)
        self._gaussians = gaussians.to(self._rasterizer.device)

    def light(self, world_from_camera: RigidTransform) -> Array:
        """See ``fvs_engine.lab.simulate.scenery.Scenery``."""
        model_from_camera = self._world_from_model.inverse().move_camera(world_from_camera)
        view = PinholeView("photograph", self.camera, model_from_camera.inverse())
        return np.asarray(render_color(self._gaussians, view, self._rasterizer), dtype=np.float64) ** GAMMA


def open_replay(root: Path, place: ReplayPlace | None = None, backend: str = "auto") -> ReplayScenery:
    """The replay world of an output folder of ``fvs reconstruct``.

    Raises ``InvalidInputError`` when the folder holds no trained model, or one of too few photographs.
    """
    model = open_model(root)
    return ReplayScenery(model.gaussians, model.views, model.camera, place, backend)


def write_poses(path: Path, views: Sequence[PinholeView], home: GeodeticPosition) -> None:
    """Write the poses of ``views``, in ENU metres around ``home``, as candidates of the service's client.

    Raises ``StorageError`` when the file cannot be written.
    """
    candidates = []
    for view in views:
        world_from_camera = view.camera_from_model.inverse()
        position = geodetic_from_enu(world_from_camera.translation, home)
        yaw_deg, pitch_deg, roll_deg = attitude_of(world_from_camera)
        pose = {"yaw_deg": yaw_deg, "pitch_deg": pitch_deg, "roll_deg": roll_deg}
        candidates.append({"id": view.name, "pose": asdict(position) | pose})
    with storage_errors(path):
        write_text_atomically(path, json.dumps(candidates, indent=1))


def _placed(views: Sequence[PinholeView], place: ReplayPlace) -> tuple[SimilarityTransform, float]:
    """The world_from_model that puts the views where ``place`` says, and how high they look."""
    cameras = [view.camera_from_model.inverse() for view in views]
    up = -np.mean([camera.rotation[:, 1] for camera in cameras], axis=0)
    if np.linalg.norm(up) < _PARALLEL:
        raise InvalidInputError(
            "The photographs of this model have no common up.", hint="Replay a model of upright photographs."
        )
    level = level_axes(up).T
    centres = np.stack([camera.translation for camera in cameras])
    middle = _looked_at(centres, np.stack([camera.rotation[:, 2] for camera in cameras]))
    offsets = (centres - middle) @ level.T
    distance = float(np.median(np.hypot(offsets[:, 0], offsets[:, 1])))
    if distance <= _STILL * float(np.abs(centres).max()):
        raise InvalidInputError(
            "The photographs of this model are all from one place.",
            hint="Replay a model whose cameras moved.",
        )
    scale = place.distance_m / distance
    height_m = place.lowest_m - scale * float(offsets[:, 2].min())
    lift = np.array([0.0, 0.0, height_m])
    return SimilarityTransform(scale, level, lift - scale * level @ middle), height_m


def _looked_at(centres: Array, directions: Array) -> Array:
    """The point [3] nearest to all viewing axes; along directions in which these do not cross, the mean."""
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    start = centres.mean(axis=0)
    moves = np.einsum("nij,nj->i", across, centres - start)
    return np.asarray(start + np.linalg.pinv(across.sum(axis=0), rcond=_PARALLEL, hermitian=True) @ moves)
