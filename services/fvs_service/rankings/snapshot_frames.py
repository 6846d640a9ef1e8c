"""Cached cameras, geometry and frames of snapshots, for rankings and plans."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.ground_of_points import LEAST_POINTS
from fvs_schema.candidates import Candidate
from fvs_schema.error_codes import FieldError
from fvs_schema.scenes import Origin
from fvs_schema.snapshots import Snapshot, SnapshotCameras
from fvs_schema.terrain import AnyTerrain, Terrain
from fvs_service.errors import InvalidRequestError, NoSnapshotError, NotFoundError
from fvs_service.principal import Principal
from fvs_service.rankings.generators import FromImages, generate
from fvs_service.rankings.port import UpdateQuality
from fvs_service.rankings.scene_geometry import SceneGeometry
from fvs_service.rankings.under_ground import require_datum
from fvs_service.scenes.poses import WorldFrame, require_on_earth
from fvs_service.scenes.repository import SceneHead
from fvs_service.snapshots.repository import find_snapshot, first_snapshots, snapshot_of
from fvs_service.snapshots.service import Snapshots
from fvs_service.storage.database import Database

_CACHED_SNAPSHOTS = 64
_CACHED_TERRAINS = 8
_MOST_UPDATES = 50
"""The first snapshots of a scene that calibrate the forecast."""


class SnapshotFrames:
    """Cameras, geometry and frames of snapshots, cached: a snapshot never changes, and many requests use it.

    ``most_candidates`` is the largest number of candidates in a request.
    """

    def __init__(self, database: Database, snapshots: Snapshots, most_candidates: int) -> None:
        self._database = database
        self._most_candidates = most_candidates
        self._snapshot = lru_cache(_CACHED_SNAPSHOTS)(self._find)
        self._cameras = lru_cache(_CACHED_SNAPSHOTS)(
            lambda snapshot_id: snapshots.cameras(self._snapshot(snapshot_id))
        )
        self._terrain = lru_cache(_CACHED_TERRAINS)(
            lambda snapshot_id: snapshots.terrain(self._snapshot(snapshot_id))
        )
        self._geometry = lru_cache(_CACHED_SNAPSHOTS)(self._geometry_of)
        self._frame = lru_cache(_CACHED_SNAPSHOTS)(
            lambda snapshot_id, origin: WorldFrame(origin, self._snapshot(snapshot_id).alignment)
        )

    def snapshot(self, principal: Principal, scene: SceneHead, snapshot_id: str | None) -> Snapshot:
        """The named snapshot of a scene, or its newest; raises ``NotFoundError``, ``NoSnapshotError``."""
        if snapshot_id is not None:
            with self._database.reading() as session:
                snapshot_of(session, principal, snapshot_id)  # the cache may outlive it
        wanted = snapshot_id or scene.snapshot_id
        if wanted is None:
            raise NoSnapshotError(
                "The scene has no model yet.",
                hint='Run an update (fvs-client update, a job {"kind": "update"}), and try again when it has '
                "made a snapshot.",
            )
        snapshot: Snapshot = self._snapshot(wanted)
        if snapshot.scene_id != scene.id:
            raise NotFoundError("There is no such snapshot.")
        return snapshot

    def cameras(self, snapshot_id: str) -> SnapshotCameras:
        """The cameras of a snapshot."""
        cameras: SnapshotCameras = self._cameras(snapshot_id)
        return cameras

    def geometry(self, snapshot_id: str) -> SceneGeometry:
        """The geometry of a snapshot in the world frame."""
        geometry: SceneGeometry = self._geometry(snapshot_id)
        return geometry

    def frame(self, snapshot_id: str, origin: Origin | None) -> WorldFrame:
        """The world frame of a snapshot."""
        frame: WorldFrame = self._frame(snapshot_id, origin)
        return frame

    def terrain(self, asked: AnyTerrain | None, snapshot_id: str, frame: WorldFrame) -> Terrain | None:
        """The ground that a request asks for, above the datum of the scene's altitudes.

        Raises ``InvalidRequestError`` for one above another datum, without georeference, and where the
        snapshot has too few points.
        """
        if asked is None:
            return None
        frame.require_origin()
        found = asked if isinstance(asked, Terrain) else self.require_ground(snapshot_id)
        require_datum(found, frame)
        return found

    def ground(self, snapshot_id: str) -> Terrain | None:
        """The ground by the snapshot's points; None where it has none."""
        found: Terrain | None = self._terrain(snapshot_id)
        return found

    def require_ground(self, snapshot_id: str) -> Terrain:
        """The ground by the snapshot's points; raises ``InvalidRequestError`` where it has none."""
        found = self.ground(snapshot_id)
        if found is None:
            raise InvalidRequestError(
                f"The model has no ground: it needs {LEAST_POINTS} sparse points, and a place on Earth.",
                hint="Give heights, or send images with GPS that overlap more.",
                errors=[FieldError("terrain", "the model has too few points")],
            )
        return found

    def updates(self, scene_id: str) -> tuple[UpdateQuality, ...]:
        """The images that each snapshot of a scene added, and the quality that it measured on them."""
        with self._database.reading() as session:
            snapshots = first_snapshots(session, scene_id, _MOST_UPDATES)
        known: set[str] = set()
        found = []
        for snapshot in snapshots:
            images = [view.image for view in self.cameras(snapshot.id).views]
            new = tuple(image for image in images if image not in known)
            found.append(UpdateQuality(images=new, psnr_db=snapshot.metrics.new_images_psnr_db))
            known.update(new)
        return tuple(found)

    def candidates(
        self,
        given: tuple[Candidate, ...] | None,
        generator: FromImages | None,
        frame: WorldFrame,
        geometry: SceneGeometry,
        *,
        current: NDArray[np.float64] | None = None,
        radius_m: float | None = None,
    ) -> Mapping[str, RigidTransform]:
        """The poses of candidates, given or generated: id → world_from_camera.

        Raises ``InvalidRequestError`` for too many, and for poses that are too far away.
        """
        if generator is not None:
            poses = generate(generator, geometry, current, radius_m)
        else:
            poses = by_id(given or (), frame)
        self.require_few(len(poses), "candidates" if generator is None else "generator")
        require_on_earth(poses)
        return poses

    def require_few(self, count: int, field: str = "generator") -> None:
        """Raise ``InvalidRequestError``, about the ``field``, for more candidates than are allowed."""
        if count > self._most_candidates:
            raise InvalidRequestError(
                f"There are {count} candidates; {self._most_candidates} are allowed.",
                hint="Split them into several rankings.",
                errors=[FieldError(field, f"there are {count}, and {self._most_candidates} are allowed")],
            )

    def _geometry_of(self, snapshot_id: str) -> SceneGeometry:
        return SceneGeometry.of(self.frame(snapshot_id, None), self.cameras(snapshot_id))

    def _find(self, snapshot_id: str) -> Snapshot:
        with self._database.reading() as session:
            return find_snapshot(session, snapshot_id)


def by_id(given: tuple[Candidate, ...], frame: WorldFrame) -> dict[str, RigidTransform]:
    """The poses of requests: id → world_from_camera."""
    cameras = frame.world_from_cameras([item.pose for item in given])
    return {item.id: camera for item, camera in zip(given, cameras, strict=True)}
