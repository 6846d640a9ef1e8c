"""The artifacts of a snapshot, written from a trained model."""

import shutil
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.export.points_ply import write_points
from fvs_engine.geometry import quaternion_from_matrix
from fvs_engine.scene.scene_model import SceneModel, usual_camera
from fvs_engine.sfm.colmap.model import MODEL_FILES
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.snapshot_cameras import intrinsics_of
from fvs_engine.splat.views import TrainingView
from fvs_schema.artifacts import CAMERAS, COLMAP, COLMAP_FOLDER, COMPRESSED, GAUSSIANS, METRICS, POINTS
from fvs_schema.images import Image
from fvs_schema.snapshots import SnapshotCameras, SnapshotMetrics, SnapshotView

Array = NDArray[np.float64]

_BOX_PERCENTILES = (2.0, 98.0)
"""Percentiles of the points along each axis that bound the box: sparse points have far outliers."""


def write_artifacts(
    folder: Path,
    views: Sequence[TrainingView],
    images: Mapping[str, Image],
    points: PointCloud,
    model: SceneModel,
    metrics: SnapshotMetrics,
    colmap: Path,
    *,
    compressed: bool = True,
) -> tuple[str, ...]:
    """Write the artifacts into an empty ``folder``; returns their names. ``images`` are by view name.

    Files that are not ``compressed`` as far as they could be are there sooner.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    # Without points, what the scene is about is where the cameras are.
    around = points.xyz if len(points) else np.stack([view.centre for view in views])
    model.export(folder / GAUSSIANS)
    write_points(folder / POINTS, points)
    (folder / CAMERAS).write_text(_cameras(views, images, around).model_dump_json(indent=1))
    (folder / METRICS).write_text(metrics.model_dump_json(indent=1))
    with zipfile.ZipFile(folder / COLMAP, "w") as archive:
        for name in MODEL_FILES:
            # Without the time of the file, equal models make equal archives.
            entry = zipfile.ZipInfo(f"{COLMAP_FOLDER}/{name}.bin")
            # To halve the bytes of 200 images takes 0.4 s of the processor.
            entry.compress_type = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
            # The default level takes four times as long for 7 % fewer bytes (50 images of fox).
            archive.writestr(entry, (colmap / f"{name}.bin").read_bytes(), compresslevel=1)
    return (GAUSSIANS, COMPRESSED, POINTS, CAMERAS, METRICS, COLMAP)


def _cameras(views: Sequence[TrainingView], images: Mapping[str, Image], points: Array) -> SnapshotCameras:
    lower, upper = np.percentile(points, _BOX_PERCENTILES, axis=0)
    model_from_camera = {view.name: view.camera_from_model.inverse() for view in views}
    shares = {view.name: view.counted_share for view in views}
    return SnapshotCameras(
        camera=intrinsics_of(usual_camera(views)),
        views=tuple(
            SnapshotView(
                image=images[name].digest,
                name=images[name].name,
                position=tuple(camera.translation.tolist()),
                orientation_wxyz=tuple(quaternion_from_matrix(camera.rotation).tolist()),
                counted_share=shares[name],
            )
            for name, camera in model_from_camera.items()
        ),
        centre=tuple(np.median(points, axis=0).tolist()),
        up=tuple(_up([camera.rotation for camera in model_from_camera.values()]).tolist()),
        lower=tuple(lower.tolist()),
        upper=tuple(upper.tolist()),
    )


def _up(rotations: Sequence[Array]) -> Array:
    """The mean upward direction of the images, in the model frame."""
    mean = -np.mean([rotation[:, 1] for rotation in rotations], axis=0)
    length = float(np.linalg.norm(mean))
    return mean / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
