"""Registration of several images, in which a camera gets its lens."""

import shutil
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from growths import growth_of, registration_request
from row_of_cameras import COUNT, row_of_cameras

from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.sfm.batch.mapping import leave_out
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.model import camera_poses
from fvs_engine.sfm.native.registration import register
from fvs_engine.sfm.native.robust_adjustment import is_likely
from fvs_engine.sfm.native.thresholds import ADJUSTMENT
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors


def test_an_image_is_rejected_after_the_camera_got_its_lens(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    """A mapper that begins with the camera of the database fails."""
    shutil.copy(kermit_sfm.model_dir.parent / "database.db", tmp_path / "database.db")
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    poses = camera_poses(model)
    right, wrong = kermit_names[5], kermit_names[-1]
    leave_out(model, [right, wrong])
    assert model.num_reg_images() == ADJUSTMENT.min_images_of_lens - 1
    camera = model.camera(1)
    camera.model, camera.params = pycolmap.CameraModelId.SIMPLE_RADIAL, camera.params[:4]
    for folder in ("model", "out"):
        (tmp_path / folder).mkdir()
    model.write_binary(tmp_path / "model")
    spread = centre_spread(np.stack([pose.translation for pose in poses.values()]))
    priors = {name: PosePrior.of_camera(pose, 0.02 * spread, 3.0) for name, pose in poses.items()}
    off = tuple(poses[wrong].translation + 3.0 * spread)
    priors[wrong] = priors[wrong].model_copy(update={"position": off})
    answer = register(
        registration_request(
            tmp_path,
            [right, wrong],
            image_dir=kermit_dir,
            refine=True,
            lens=True,
            priors=PosePriors(by_name=priors),
            adjusted_images=ADJUSTMENT.min_images_of_lens - 1,
            adjusted_points=model.num_points3D(),
        ),
        lambda _: None,
    )
    assert answer.registered == (right,)
    assert list(answer.rejected) == [wrong]
    assert pycolmap.Reconstruction(tmp_path / "out").camera(1).model_name == "RADIAL"


@pytest.mark.system
@pytest.mark.parametrize(
    ("name", "params"),
    [("SIMPLE_RADIAL", [705.0, 400.0, 300.0, 0.0]), ("RADIAL", [705.0, 400.0, 300.0, 0.0, 0.9])],
)
def test_no_pose_is_lost_to_an_estimate_that_no_lens_has(name: str, params: list[float], tmp_path: Path):
    """COLMAP removes all images of a camera whose coefficients exceed 1, once it has 20 images."""
    taken_with = pycolmap.Camera(
        model="RADIAL", width=800, height=600, params=[700.0, 400.0, 300.0, 0.0, 2.5]
    )
    start = pycolmap.Camera(model=name, width=800, height=600, params=params, camera_id=1)
    model = row_of_cameras(0.2, 8, taken_with=taken_with, camera=start)
    growth = growth_of(model, tmp_path, lens=True)
    growth.adjust_all()
    growth.mapper.end_reconstruction(False)
    assert model.num_reg_images() == COUNT
    assert is_likely(model.camera(1))
