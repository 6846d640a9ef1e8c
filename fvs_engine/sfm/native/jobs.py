"""The native jobs of sets of images: functions of a request, which run in the SfM child process."""

import contextlib
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from fvs_engine.images.masks import read_mask, write_mask
from fvs_engine.sfm.colmap.database import delete_database, image_ids, remove_images
from fvs_engine.sfm.jobs import (
    CalibrateViewGraph,
    ExtractFeatures,
    ImportImages,
    MapGlobally,
    MapImages,
    MapIncrementally,
    Report,
    TriangulatePoints,
    UndistortImages,
)
from fvs_engine.sfm.native.mapper_options import mapper_options, thread_count
from fvs_engine.sfm.native.matching import match
from fvs_engine.sfm.native.pose_review import PoseReview
from fvs_engine.sfm.native.robust_adjustment import RobustAdjustment, remove_outliers
from fvs_schema.masks import MASKS

_TINY = 1e-7
"""A coefficient that moves no pixel by a thousandth, and that COLMAP does not take for zero."""


def import_images(request: ImportImages, _report: Report) -> None:
    """See ``ImportImages``."""
    pycolmap.Database.open(request.database).close()  # creates it; the importer itself does not
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = request.model
    reader.camera_params = request.params
    reader.existing_camera_id = request.camera_id
    names = list(request.names)
    pycolmap.import_images(request.database, request.image_dir, pycolmap.CameraMode.SINGLE, names, reader)


def extract(request: ExtractFeatures, _report: Report) -> None:
    """See ``ExtractFeatures``."""
    options = pycolmap.FeatureExtractionOptions()
    options.max_image_size = request.max_image_size_px
    options.num_threads = thread_count(request.threads)
    options.use_gpu = False
    options.sift.max_num_features = request.max_features
    options.sift.first_octave = -1 if request.upsampled else 0
    reader = pycolmap.ImageReaderOptions()
    if request.mask_dir is not None:
        reader.mask_path = request.mask_dir
    pycolmap.extract_features(
        request.database,
        request.image_dir,
        list(request.names),
        reader_options=reader,
        extraction_options=options,
    )


def calibrate(request: CalibrateViewGraph, _report: Report) -> bool:
    """See ``CalibrateViewGraph``."""
    delete_database(request.target)
    shutil.copyfile(request.database, request.target)
    others = image_ids(request.target).keys() - set(request.names)
    if others:
        remove_images(request.target, others)
    options = pycolmap.ViewGraphCalibrationOptions()
    options.random_seed = request.seed
    return bool(pycolmap.calibrate_view_graph(request.target, options))


def map_incremental(request: MapIncrementally, report: Report) -> None:
    """See ``MapIncrementally``."""
    pycolmap.set_random_seed(request.seed)
    options = mapper_options(request)
    options.image_names = list(request.names)
    options.min_model_size = 3
    registered = 2

    def next_image() -> None:
        nonlocal registered
        registered += 1
        report(registered)

    models = pycolmap.incremental_mapping(
        request.database, request.image_dir, request.out_dir, options, next_image_callback=next_image
    )
    _adjust(models, request)


def map_global(request: MapGlobally, _report: Report) -> None:
    """See ``MapGlobally``."""
    pycolmap.set_random_seed(request.seed)
    options = pycolmap.GlobalPipelineOptions()
    options.image_names = list(request.names)
    options.random_seed = options.mapper.random_seed = request.seed
    options.num_threads = options.mapper.num_threads = thread_count(request.threads)
    adjustment = options.mapper.bundle_adjustment
    adjustment.refine_focal_length = adjustment.refine_extra_params = request.refine
    options.mapper.bundle_adjustment = adjustment
    _adjust(pycolmap.global_mapping(request.database, request.image_dir, request.out_dir, options), request)


def _adjust(models: Mapping[int, pycolmap.Reconstruction], request: MapImages) -> None:
    """Adjust the models of a mapper robustly, and write them to ``out_dir``/0, 1, … again."""
    refine, lens, threads = request.refine, request.lens, thread_count(request.threads)
    for number, model in models.items():
        RobustAdjustment(model, refine=refine, lens=lens, threads=threads).solve()
        remove_outliers(model)
        observations = pycolmap.ObservationManager(model)
        if PoseReview(model, observations, request.database, request.seed).of(model.reg_image_ids()):
            RobustAdjustment(model, refine=refine, lens=lens, threads=threads).solve()
            remove_outliers(model)
        model.write_binary(request.out_dir / str(number))


def triangulate(request: TriangulatePoints, _report: Report) -> int:
    """See ``TriangulatePoints``.

    Points in two images alone are kept, which COLMAP leaves out by default: given poses suffice for them, and
    models that start without them are worse (docs/design/training.md).
    """
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = thread_count(request.threads)
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    model = pycolmap.Reconstruction(request.model_dir)
    options.triangulation.ignore_two_view_tracks = False
    image_dir, out_dir = request.image_dir, request.out_dir
    if model.num_reg_images() > 1:  # the search for the crashing image tries single ones
        # The database has cameras of its own for these images, often of another model; COLMAP needs equal
        # ones.
        with tempfile.TemporaryDirectory() as scratch:
            given = Path(scratch) / "given.db"
            _copy_with_cameras_of(model, request.database, given)
            model = pycolmap.triangulate_points(model, given, image_dir, out_dir, True, options, False)
    model.extract_colors_for_all_images(image_dir)
    model.write_binary(out_dir)
    return int(model.num_points3D())


def _copy_with_cameras_of(model: pycolmap.Reconstruction, database: Path, target: Path) -> None:
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


def undistort(request: UndistortImages, _report: Report) -> None:
    """See ``UndistortImages``."""
    bent = request.out_dir / "bent"
    model_dir = _with_bent_fisheyes(request.model_dir, bent)
    pycolmap.undistort_images(
        request.out_dir,
        model_dir,
        request.image_dir,
        list(request.names),
        output_type="COLMAP",
        undistort_options=pycolmap.UndistortCameraOptions(),
        jpeg_quality=request.jpeg_quality,
    )
    _undistort_masks(request, model_dir)
    # COLMAP prepares for its dense stereo, which is not used here.
    for folder in ("stereo", bent.name):
        shutil.rmtree(request.out_dir / folder, ignore_errors=True)
    for script in request.out_dir.glob("run-colmap-*.sh"):
        script.unlink()


def _undistort_masks(request: UndistortImages, model_dir: Path) -> None:
    """Undistort the masks as COLMAP undistorts the images, whose empty pixels are masked, too."""
    masks = {name: mask for name in request.names if (mask := read_mask(request.image_dir, name)) is not None}
    if not masks:
        return
    model = pycolmap.Reconstruction(model_dir)
    for image in model.images.values():
        if image.name not in masks:
            continue
        mask, camera = masks[image.name], model.cameras[image.camera_id]
        if camera.model != pycolmap.CameraModelId.PINHOLE:  # else the image is copied
            grey = pycolmap.Bitmap.from_array(mask.astype(np.uint8) * np.uint8(255))
            found, _ = pycolmap.undistort_image(pycolmap.UndistortCameraOptions(), grey, camera)
            mask = found.to_array() == 255
        write_mask(mask, request.out_dir / MASKS / f"{image.name}.png")


def _with_bent_fisheyes(model_dir: Path, target: Path) -> Path:
    """The model, or a copy in ``target`` in which fisheye cameras without coefficients have a tiny one.

    COLMAP takes such a camera for undistorted and leaves its images as they are.
    """
    model = pycolmap.Reconstruction(model_dir)
    plain = [
        each for each in model.cameras.values() if each.is_perspective_fisheye() and each.is_undistorted()
    ]
    if not plain:
        return model_dir
    for camera in plain:
        focals = (camera.focal_length_x, camera.focal_length_y)
        middle = (camera.principal_point_x, camera.principal_point_y)
        camera.model = pycolmap.CameraModelId.OPENCV_FISHEYE
        camera.params = np.array([*focals, *middle, _TINY, 0.0, 0.0, 0.0])
    target.mkdir()
    model.write_binary(target)
    return target


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
