"""The native jobs: functions of JSON arguments that run in the SfM child process.

A job writes either into the database, in transactions, so that a repeated one resumes; or into a folder or
file beside the final one, which the caller renames when the job is done.
"""

import contextlib
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pycolmap

from fvs_engine.sfm.colmap.database import image_ids, remove_images
from fvs_engine.sfm.native.matching import match
from fvs_engine.sfm.native.pose_review import review_poses
from fvs_engine.sfm.native.report import Report
from fvs_engine.sfm.native.robust_adjustment import RobustAdjustment, remove_outliers


def _threads(threads: int | None) -> int:
    return -1 if threads is None else threads


def import_images(
    _report: Report,
    *,
    database: str,
    image_dir: str,
    names: list[str],
    model: str,
    params: str,
    camera_id: int,
) -> None:
    """Write images of one camera into the database; ``camera_id`` -1 makes one; ``params`` may be empty."""
    pycolmap.Database.open(database).close()  # creates it; the importer itself does not
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = model
    reader.camera_params = params
    reader.existing_camera_id = camera_id
    pycolmap.import_images(database, image_dir, pycolmap.CameraMode.SINGLE, names, reader)


def extract(
    _report: Report,
    *,
    database: str,
    image_dir: str,
    names: list[str],
    max_image_size: int,
    upsampled: bool,
    max_features: int,
    threads: int | None,
) -> None:
    """Extract SIFT features of images, ``upsampled`` twofold or not; those that have them are skipped."""
    options = pycolmap.FeatureExtractionOptions()
    options.max_image_size = max_image_size
    options.num_threads = _threads(threads)
    options.use_gpu = False
    options.sift.max_num_features = max_features
    options.sift.first_octave = -1 if upsampled else 0
    pycolmap.extract_features(database, image_dir, names, extraction_options=options)


def calibrate(_report: Report, *, database: str, target: str, names: list[str], seed: int) -> bool:
    """Copy the database to ``target`` and calibrate the view graph of ``names`` there, without other images.

    Returns whether that succeeded.
    """
    for old in (target, f"{target}-wal", f"{target}-shm"):
        Path(old).unlink(missing_ok=True)
    shutil.copyfile(database, target)
    others = image_ids(Path(target)).keys() - set(names)
    if others:
        remove_images(Path(target), others)
    options = pycolmap.ViewGraphCalibrationOptions()
    options.random_seed = seed
    return bool(pycolmap.calibrate_view_graph(target, options))


def map_incremental(
    report: Report,
    *,
    database: str,
    image_dir: str,
    out_dir: str,
    names: list[str],
    refine: bool,
    lens: bool,
    seed: int,
    threads: int | None,
) -> int:
    """Incremental mapping of ``names``; the models go to ``out_dir``/0, 1, …; their number.

    Each is adjusted robustly at the end; ``refine`` and ``lens`` as for ``RobustAdjustment``.
    """
    pycolmap.set_random_seed(seed)
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = seed
    options.num_threads = _threads(threads)
    options.image_names = names
    options.min_model_size = 3
    options.ba_refine_focal_length = options.ba_refine_extra_params = refine
    options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = refine
    registered = 2

    def next_image() -> None:
        nonlocal registered
        registered += 1
        report(registered)

    models = pycolmap.incremental_mapping(
        database, image_dir, out_dir, options, next_image_callback=next_image
    )
    _adjust(models, out_dir, Path(database), refine=refine, lens=lens, seed=seed, threads=threads)
    return len(models)


def map_global(
    _report: Report,
    *,
    database: str,
    image_dir: str,
    out_dir: str,
    names: list[str],
    refine: bool,
    lens: bool,
    seed: int,
    threads: int | None,
) -> int:
    """Global mapping (GLOMAP) of ``names``, otherwise as ``map_incremental``."""
    pycolmap.set_random_seed(seed)
    options = pycolmap.GlobalPipelineOptions()
    options.image_names = names
    options.random_seed = options.mapper.random_seed = seed
    options.num_threads = options.mapper.num_threads = _threads(threads)
    adjustment = options.mapper.bundle_adjustment
    adjustment.refine_focal_length = adjustment.refine_extra_params = refine
    options.mapper.bundle_adjustment = adjustment
    models = pycolmap.global_mapping(database, image_dir, out_dir, options)
    _adjust(models, out_dir, Path(database), refine=refine, lens=lens, seed=seed, threads=threads)
    return len(models)


def _adjust(
    models: Mapping[int, pycolmap.Reconstruction],
    out_dir: str,
    database: Path,
    *,
    refine: bool,
    lens: bool,
    seed: int,
    threads: int | None,
) -> None:
    """Adjust the models of a mapper robustly, and write them to ``out_dir``/0, 1, … again."""
    for number, model in models.items():
        RobustAdjustment(model, refine=refine, lens=lens, threads=_threads(threads)).solve()
        remove_outliers(model)
        observations = pycolmap.ObservationManager(model)
        if review_poses(model, observations, database, model.reg_image_ids(), seed):
            RobustAdjustment(model, refine=refine, lens=lens, threads=_threads(threads)).solve()
            remove_outliers(model)
        model.write_binary(str(Path(out_dir) / str(number)))


def triangulate(
    _report: Report, *, database: str, image_dir: str, model_dir: str, out_dir: str, threads: int | None
) -> int:
    """Triangulate points for the poses of ``model_dir``, which do not change; returns their number.

    Points in two images alone are kept, which COLMAP leaves out by default: given poses suffice for them, and
    models that start without them are worse (docs/design/training.md).
    """
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = _threads(threads)
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    model = pycolmap.Reconstruction(model_dir)
    options.triangulation.ignore_two_view_tracks = False
    if model.num_reg_images() > 1:  # the search for the crashing image tries single ones
        # The database has cameras of its own for these images, often of another model; COLMAP needs equal
        # ones.
        with tempfile.TemporaryDirectory() as scratch:
            given = str(Path(scratch) / "given.db")
            _copy_with_cameras_of(model, database, given)
            model = pycolmap.triangulate_points(model, given, image_dir, out_dir, True, options, False)
    model.extract_colors_for_all_images(image_dir)
    model.write_binary(out_dir)
    return int(model.num_points3D())


def _copy_with_cameras_of(model: pycolmap.Reconstruction, database: str, target: str) -> None:
    """A database with the model's images and cameras, and the keypoints and verified matches of another."""
    with (
        contextlib.closing(pycolmap.Database.open(database)) as source,
        contextlib.closing(pycolmap.Database.open(target)) as given,
    ):
        for camera in model.cameras.values():
            given.write_camera(camera, use_camera_id=True)
        for rig in model.rigs.values():
            given.write_rig(rig, use_rig_id=True)
        for frame in model.frames.values():
            given.write_frame(frame, use_frame_id=True)
        for image_id, image in model.images.items():
            given.write_image(image, use_image_id=True)
            given.write_keypoints(image_id, source.read_keypoints(image_id))
        for pair_id, geometry in zip(*source.read_two_view_geometries(), strict=True):
            first, second = pycolmap.pair_id_to_image_pair(pair_id)
            if model.exists_image(first) and model.exists_image(second):
                given.write_two_view_geometry(first, second, geometry)


def undistort(
    _report: Report, *, model_dir: str, image_dir: str, out_dir: str, names: list[str], quality: int
) -> None:
    """A pinhole model in ``out_dir``/sparse, and those of its images in ``names`` in ``out_dir``/images."""
    options = pycolmap.UndistortCameraOptions()
    pycolmap.undistort_images(
        out_dir,
        model_dir,
        image_dir,
        names,
        output_type="COLMAP",
        undistort_options=options,
        jpeg_quality=quality,
    )
    # COLMAP prepares for its dense stereo, which is not used here.
    shutil.rmtree(Path(out_dir) / "stereo", ignore_errors=True)
    for script in Path(out_dir).glob("run-colmap-*.sh"):
        script.unlink()


JOBS: Mapping[str, Callable[..., Any]] = {
    job.__name__: job
    for job in (
        import_images,
        extract,
        match,
        calibrate,
        map_incremental,
        map_global,
        triangulate,
        undistort,
    )
}
"""Name → job; ``find_job`` adds those that are slow to import."""


def find_job(name: str) -> Callable[..., Any]:
    """The job of that name; some are imported here because their imports would slow down every other job."""
    if name in JOBS:
        return JOBS[name]
    from fvs_engine.sfm.native.guided import register_guided
    from fvs_engine.sfm.native.localisation import copy_features, localise
    from fvs_engine.sfm.native.registration import register
    from fvs_engine.sfm.native.two_view_points import two_view_points
    from fvs_engine.sfm.native.veto import veto

    others: Mapping[str, Callable[..., Any]] = {
        "register": register,
        "register_guided": register_guided,
        "localise": localise,
        "copy_features": copy_features,
        "veto": veto,
        "two_view_points": two_view_points,
    }
    return others[name]
