"""Accuracy on whole scenes with ground truth, from photographs alone.

Mappers do not repeat across settings and threads, so nothing here says which of them fails. Every candidate
is measured against the truth: the kept model is right, and whatever was grossly wrong was rejected.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray

from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import umeyama
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import MappedModel, load_models
from fvs_engine.sfm.batch.reconstruct import SfmResult, reconstruct
from fvs_engine.sfm.colmap.database import read_keypoints, read_verified_pairs
from fvs_engine.sfm.pose_priors import ImageSet, PosePriors
from fvs_engine.sfm.settings import GateSettings, SfmSettings
from fvs_engine.sfm.verification.evidence import ModelEvidence
from fvs_engine.sfm.verification.gate import Judgement, decide
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

Centres = dict[str, NDArray[np.float64]]

WRONG_FOX = Path(__file__).parent / "wrong_fox"
"""Poses that global mapping really found from these photographs, wrong and with a healthy report."""

GROSS_SHARE = 0.1
"""A model whose median centre is off by more than this share of the spread is wrong, not inaccurate."""


def strecha_centres(folder: Path) -> Centres:
    """Camera centres in m: the eighth row of each survey file."""
    centres = {}
    for file in (folder / "gt_dense_cameras").glob("*.camera"):
        rows = [line.split() for line in file.read_text().splitlines() if line.strip()]
        centres[file.name.removesuffix(".camera")] = np.array(rows[7], dtype=np.float64)
    return centres


def fox_centres(folder: Path) -> Centres:
    frames = json.loads((folder / "transforms.json").read_text())["frames"]
    return {Path(f["file_path"]).name: np.array(f["transform_matrix"])[:3, 3] for f in frames}


def errors(found: Centres, truth: Centres) -> tuple[NDArray[np.float64], float]:
    """Distances after Umeyama, and the spread of the true centres."""
    source, target = np.stack(list(found.values())), np.stack([truth[name] for name in found])
    return np.linalg.norm(umeyama(source, target).apply(source) - target, axis=1), centre_spread(target)


def model_centres(model: pycolmap.Reconstruction) -> Centres:
    return {image.name: image.projection_center() for image in model.images.values() if image.has_pose}


def find_cameras(folder: Path, out_dir: Path, names: Sequence[str] = ()) -> SfmResult:
    """Nothing is known but the photographs ``names``, all if there are none."""
    names = names or sorted(path.name for path in (folder / "images").iterdir())
    return reconstruct(ImageSet(folder / "images", names), out_dir, SfmSettings(), Monitor())


def assert_gross_errors_were_rejected(result: SfmResult, truth: Centres) -> None:
    wrong = set()
    for candidate in result.report.candidates:
        mapping = result.model_dir.parent / "mapping" / candidate.mapper
        found, spread = errors(model_centres(load_models(mapping)[0]), truth)
        if np.median(found) > GROSS_SHARE * spread:
            wrong.add(candidate.mapper)
    rejected = {c.mapper for c in result.report.candidates if c.verdict == "rejected"}
    assert wrong <= rejected, result.report.candidates


def judge(model: pycolmap.Reconstruction, folder: Path) -> Judgement:
    """The gate on a model that no mapper of this run made, with the matches of this run."""
    pairs = read_verified_pairs(folder / "database.db", MIN_PAIR_MATCHES)
    ids = {image_id for pair in pairs for image_id in (pair.first, pair.second)}
    evidence = ModelEvidence(pairs, read_keypoints(folder / "database.db", ids), PosePriors())
    mapped = MappedModel.of_models("any", [model], evidence, GateSettings(), Monitor())
    return decide([mapped.judged], GateSettings()).judgements[0]


def move_cameras(model: pycolmap.Reconstruction, poses_file: Path) -> None:
    """Give every image of the model the pose that the file has for it."""
    for line in poses_file.read_text().splitlines():
        if line.startswith("#"):
            continue
        name, *numbers = line.split()
        w, x, y, z, *translation = map(float, numbers)
        image = model.find_image_with_name(name)
        assert image is not None
        rotation = pycolmap.Rotation3d(np.array([x, y, z, w]))
        image.frame.set_cam_from_world(image.camera_id, pycolmap.Rigid3d(rotation, np.array(translation)))


def test_fox_is_right_and_no_wrong_model_passes(data_dir: Path, tmp_path: Path):
    truth = fox_centres(data_dir / "fox")
    result = find_cameras(data_dir / "fox", tmp_path)
    assert result.report.registered == 50
    found, spread = errors(result.reconstruction.centres(), truth)
    assert np.median(found) <= 0.01 * spread
    assert_gross_errors_were_rejected(result, truth)

    # Whether a mapper falls for the repeating wallpaper today or not: these models it did make of it.
    model = pycolmap.Reconstruction(result.model_dir)
    assert judge(model, tmp_path).verdict == "accepted"
    wrong_models = sorted(WRONG_FOX.iterdir())
    assert len(wrong_models) == 2
    for poses_file in wrong_models:
        move_cameras(model, poses_file)
        found, spread = errors(model_centres(model), truth)
        assert np.median(found) > GROSS_SHARE * spread
        assert judge(model, tmp_path).verdict == "rejected"


def test_fountain_without_intrinsics_is_right_to_five_millimetres(data_dir: Path, tmp_path: Path):
    truth = strecha_centres(data_dir / "fountain-P11")
    result = find_cameras(data_dir / "fountain-P11", tmp_path)
    assert result.report.registered == 11
    found, _ = errors(result.reconstruction.centres(), truth)
    assert np.median(found) <= 0.005  # 0.006 with the principal point in the middle
    assert_gross_errors_were_rejected(result, truth)


def test_castle_without_intrinsics_is_right_to_a_tenth_of_a_metre(data_dir: Path, tmp_path: Path):
    truth = strecha_centres(data_dir / "castle-P19")
    result = find_cameras(data_dir / "castle-P19", tmp_path)
    found, _ = errors(result.reconstruction.centres(), truth)
    assert np.median(found) <= 0.100  # 0.14 with the principal point in the middle
    assert_gross_errors_were_rejected(result, truth)


def test_chance_matches_of_castle_reject_no_right_model(data_dir: Path, tmp_path: Path):
    # Ninety matches join three images with the rest; a dozen pairs of different walls have twice as many.
    truth = strecha_centres(data_dir / "castle-P19")
    names = [f"{k:04d}.jpg" for k in (*range(12), 13, 14, 15)]
    result = find_cameras(data_dir / "castle-P19", tmp_path, names)
    assert result.report.registered == len(names)
    found, spread = errors(result.reconstruction.centres(), truth)
    assert np.median(found) <= 0.01 * spread
    assert_gross_errors_were_rejected(result, truth)
