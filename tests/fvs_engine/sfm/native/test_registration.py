"""Registration of several images, in which a camera gets its lens."""

import shutil
from pathlib import Path

import numpy as np
import pycolmap

from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.sfm.batch.mapping import leave_out
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.model import camera_poses
from fvs_engine.sfm.native.registration import register
from fvs_engine.sfm.native.robust_adjustment import MIN_IMAGES_OF_LENS
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors


def test_an_image_is_rejected_after_the_camera_got_its_lens(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    """A mapper that begins with the camera of the database fails."""
    database = shutil.copy(kermit_sfm.model_dir.parent / "database.db", tmp_path / "database.db")
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    poses = camera_poses(model)
    right, wrong = kermit_names[5], kermit_names[-1]
    leave_out(model, [right, wrong])
    assert model.num_reg_images() == MIN_IMAGES_OF_LENS - 1
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
        lambda _: None,
        database=str(database),
        image_dir=str(kermit_dir),
        model_dir=str(tmp_path / "model"),
        out_dir=str(tmp_path / "out"),
        names=[right, wrong],
        refine=True,
        lens=True,
        priors=PosePriors(by_name=priors).model_dump(mode="json"),
        witness=None,
        min_image_support=0.75,
        adjust_every=0.1,
        adjusted_images=MIN_IMAGES_OF_LENS - 1,
        adjusted_points=model.num_points3D(),
        seed=0,
        threads=1,
    )
    assert answer["registered"] == [right]
    assert list(answer["rejected"]) == [wrong]
    assert pycolmap.Reconstruction(tmp_path / "out").camera(1).model_name == "RADIAL"
