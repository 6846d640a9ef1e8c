"""A large synthetic scene for benchmarks of the console: many photographs, and a model of many Gaussians.

Photographs go in through the service, the model is committed as by a worker: nobody wants to train for hours
before a page is measured.
"""

import io
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import piexif
import torch
from fvs_service.snapshots.service import NewSnapshot
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "fixtures"))
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "servers"))

from exif_gps import exif_gps
from gateways import Gateway, running_gateway, settings_for

from fvs_engine.export.points_ply import write_points
from fvs_engine.geometry import PinholeCamera, RigidTransform, quaternion_from_matrix
from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu
from fvs_engine.lab.simulate import survey
from fvs_engine.sfm.colmap.model import write_colmap
from fvs_engine.sfm.reconstruction import PointCloud, Reconstruction
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.ply import write_ply
from fvs_engine.splat.spz import write_spz
from fvs_engine.views import View
from fvs_schema.artifacts import CAMERAS, COLMAP, COLMAP_FOLDER, COMPRESSED, GAUSSIANS, METRICS, POINTS
from fvs_schema.scenes import Alignment, AlignmentStatus
from fvs_schema.snapshots import PinholeIntrinsics, SnapshotCameras, SnapshotMetrics, SnapshotView

HOME = GeodeticPosition(47.3769, 8.5417, 440.0)
_SIZE = (160, 120)
_FOCAL_PX = 104.0


def make_scene(root: Path, images: int, gaussians: int) -> str:
    """Make the scene in the service's folder ``root``; returns its id. No service may run there meanwhile."""
    poses = survey(images)
    with running_gateway(settings_for(root, {})) as gateway:
        scene_id = gateway.scene(name=f"{images} photographs")
        digests = []
        for number, pose in enumerate(poses):
            answer = gateway.put(scene_id, photograph(number, pose), name=_name(number))
            answer.raise_for_status()
            digests.append(answer.json()["digest"])
        with tempfile.TemporaryDirectory() as folder:
            _commit(gateway, scene_id, _model(Path(folder), poses, digests, gaussians))
    return scene_id


def photograph(number: int, pose: RigidTransform) -> bytes:
    """A small photograph with GPS; each number has its own."""
    draw = np.random.default_rng(number)
    coarse = draw.integers(40, 220, (6, 8, 3), dtype=np.uint8)
    exif = piexif.dump({"GPS": exif_gps(geodetic_from_enu(pose.translation, HOME))})
    file = io.BytesIO()
    Image.fromarray(coarse).resize(_SIZE).save(file, "JPEG", quality=90, exif=exif)
    return file.getvalue()


def _commit(gateway: Gateway, scene_id: str, made: NewSnapshot) -> None:
    job_id = gateway.queue(scene_id)
    storage, lease = gateway.application.storage, gateway.lease(scene_id)
    job = storage.ledger.start(lease, job_id, 1)
    assert job is not None
    storage.snapshots.commit(lease, job, "snapshot", made)
    storage.ledger.succeed(lease, job_id)
    storage.leases.release(lease)


def _model(folder: Path, poses: list[RigidTransform], digests: list[str], count: int) -> NewSnapshot:
    """Ground with hills and houses below the cameras; the model's frame is the world's."""
    draw = np.random.default_rng(0)
    reach = np.abs([pose.translation[:2] for pose in poses]).max(axis=0) + 15.0
    places = draw.uniform(-reach, reach, (count, 2))
    cell = np.floor(places / 14.0)
    house = ((cell * [7, 13]).sum(axis=1) % 3 == 0) & (np.abs(places / 14.0 - cell - 0.5) < 0.3).all(axis=1)
    hills = 2.0 * np.sin(places[:, 0] / 25.0) + 1.5 * np.cos(places[:, 1] / 18.0)
    means = np.column_stack([places, hills + np.where(house, 5.0, 0.0) + draw.normal(0, 0.1, count)])
    colours = np.where(house[:, None], [0.6, 0.35, 0.25], [0.3, 0.45, 0.2]) + draw.normal(0, 0.06, (count, 3))
    model = Gaussians(
        means=torch.tensor(means, dtype=torch.float32),
        log_scales=torch.tensor(np.log(draw.uniform(0.15, 0.5, (count, 3))), dtype=torch.float32),
        quaternions_wxyz=torch.tensor(draw.normal(size=(count, 4)), dtype=torch.float32),
        opacity_logits=torch.full((count,), 2.0),
        sh_dc=torch.tensor((colours - 0.5) / 0.28209479, dtype=torch.float32),
        sh_rest=torch.zeros((count, 0, 3)),
    )
    write_ply(folder / GAUSSIANS, model)
    write_spz(folder / COMPRESSED, model)
    some = draw.choice(count, count // 5, replace=False)
    points = PointCloud(means[some], (255 * colours[some].clip(0, 1)).astype(np.uint8))
    write_points(folder / POINTS, points)
    (folder / CAMERAS).write_text(_cameras(poses, digests, reach).model_dump_json())
    _write_colmap(folder, poses, points)
    metrics = SnapshotMetrics(
        registered=len(poses),
        unregistered=0,
        points=len(points),
        iterations=1,
        gaussians=count,
        sh_degree=0,
    )
    (folder / METRICS).write_text(metrics.model_dump_json())
    return NewSnapshot(
        metrics=metrics,
        alignment=Alignment(
            status=AlignmentStatus.ALIGNED, rms_m=0.5, inliers=len(poses), positions=len(poses)
        ),
        files={name: folder / name for name in (GAUSSIANS, COMPRESSED, POINTS, CAMERAS, METRICS, COLMAP)},
        registered=digests,
        unregistered={},
    )


def _write_colmap(folder: Path, poses: list[RigidTransform], points: PointCloud) -> None:
    """The same cameras and points for COLMAP, without observations."""
    width, height = _SIZE
    camera = PinholeCamera(width, height, _FOCAL_PX, _FOCAL_PX, width / 2, height / 2)
    views = [View(_name(number), camera, pose.inverse()) for number, pose in enumerate(poses)]
    write_colmap(Reconstruction(tuple(views), points, np.zeros(len(points))), folder / COLMAP_FOLDER)
    with zipfile.ZipFile(folder / COLMAP, "w") as archive:
        for file in (folder / COLMAP_FOLDER).iterdir():
            archive.write(file, f"{COLMAP_FOLDER}/{file.name}")


def _name(number: int) -> str:
    return f"survey-{number:04d}.jpg"


def _cameras(poses: list[RigidTransform], digests: list[str], reach: np.ndarray) -> SnapshotCameras:
    width, height = _SIZE
    return SnapshotCameras(
        camera=PinholeIntrinsics(
            width_px=width,
            height_px=height,
            fx_px=_FOCAL_PX,
            fy_px=_FOCAL_PX,
            cx_px=width / 2,
            cy_px=height / 2,
        ),
        views=tuple(
            SnapshotView(
                image=digest,
                name=_name(number),
                position=tuple(pose.translation.tolist()),
                orientation_wxyz=tuple(quaternion_from_matrix(pose.rotation).tolist()),
            )
            for number, (digest, pose) in enumerate(zip(digests, poses, strict=True))
        ),
        centre=(0, 0, 0),
        up=(0, 0, 1),
        lower=(*(-reach).tolist(), -4.0),
        upper=(*reach.tolist(), 10.0),
    )
