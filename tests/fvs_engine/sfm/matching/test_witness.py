"""The witness: where its matches are kept, that nothing is computed twice, and that it is not mixed in."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.aliked.weights_file import INSTALL, aliked_weights
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import image_ids, matched_pairs, read_keypoints, read_verified_pairs
from fvs_engine.sfm.matching import witness
from fvs_engine.sfm.matching.witness import ask_witness
from fvs_engine.sfm.native.aliked import match_aliked
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages
from fvs_engine.sfm.verification.pair_check import check_pairs


def ignore(_number: int) -> None:
    """Progress that nobody follows."""


@pytest.fixture
def folder(kermit_sfm: SfmResult, tmp_path: Path) -> SfmFolder:
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", tmp_path / "database.db")
    return SfmFolder(tmp_path)


def test_without_the_extra_or_by_the_settings_it_is_not_asked(
    folder: SfmFolder, kermit_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(witness, "aliked_weights", lambda: None)
    assert ask_witness(Stages(folder, SfmSettings(), Monitor()), kermit_dir) is None
    monkeypatch.setattr(witness, "aliked_weights", lambda: tmp_path / "weights.pth")
    assert ask_witness(Stages(folder, SfmSettings(witness=False), Monitor()), kermit_dir) is None
    assert not folder.witness.exists()


def test_it_is_asked_about_the_pairs_of_the_named_images_that_were_matched(
    folder: SfmFolder, kermit_dir: Path, kermit_names: list[str], monkeypatch: pytest.MonkeyPatch
):
    """The jobs are replaced: what they get is the point."""
    asked: list[tuple[str, Sequence[Any]]] = []

    def native_over(self: Stages, job: str, items: Sequence[Any], *_: Any, **__: Any) -> None:
        asked.append((job, items))
        shutil.copyfile(self.folder.database, self.folder.witness)
        if job == "extract_aliked":
            numbers = image_ids(self.folder.witness)
            with pycolmap.Database.open(self.folder.witness) as opened:
                opened.delete_two_view_geometry(numbers[kermit_names[0]], numbers[kermit_names[3]])

    monkeypatch.setattr(witness, "aliked_weights", lambda: Path("weights.pth"))
    monkeypatch.setattr(Stages, "native_over", native_over)
    ask_witness(Stages(folder, SfmSettings(), Monitor()), kermit_dir, [kermit_names[3]])
    assert [job for job, _ in asked] == ["extract_aliked", "match_aliked"]
    assert asked[0][1] == kermit_names
    assert [set(pair) for pair in asked[1][1]] == [{kermit_names[0], kermit_names[3]}]
    asked.clear()
    said = ask_witness(Stages(folder, SfmSettings(), Monitor()), kermit_dir)
    assert asked == []  # all of it is there
    assert said is not None
    assert len(said.pairs) > 0


def test_pairs_are_matched_and_verified_once(tmp_path: Path):
    """Two views of one cloud of points, whose descriptors are known."""
    generator = np.random.default_rng(0)
    points = generator.uniform([-2, -2, 4], [2, 2, 8], size=(200, 3))
    descriptors = generator.normal(size=(200, 128))
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    database = tmp_path / "witness.db"
    order = generator.permutation(200)
    with pycolmap.Database.open(database) as opened:
        camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", 500.0, 640, 480)
        opened.write_camera(camera, use_camera_id=True)
        for image_id, shift, kept in ((1, 0.0, np.arange(200)), (2, 0.7, order)):
            image = pycolmap.Image(name=f"{image_id}.jpg", camera_id=1, image_id=image_id)
            opened.write_image(image, use_image_id=True)
            seen = points[kept] - [shift, 0.0, 0.0]
            pixels = 500.0 * seen[:, :2] / seen[:, 2:] + [320.0, 240.0]
            halves = np.ascontiguousarray(descriptors[kept], dtype=np.float16)
            stored = halves.view(np.uint8).reshape(200, -1)
            kind = pycolmap.FeatureExtractorType.UNDEFINED
            opened.write_descriptors(image_id, pycolmap.FeatureDescriptors(kind, stored))
            opened.write_keypoints(image_id, pixels.astype(np.float32))
    for _ in range(2):
        done: list[int] = []
        match_aliked(done.append, database=str(database), pairs=[("2.jpg", "1.jpg")], seed=0)
        assert done == [1]
        (pair,) = read_verified_pairs(database, 15)
        assert (pair.first, pair.second) == (1, 2)
        assert len(pair.matches) > 190
        assert (order[pair.matches[:, 1]] == pair.matches[:, 0]).all()
    assert matched_pairs(database) == {(1, 2)}


@pytest.mark.slow  # two seconds an image
@pytest.mark.skipif(aliked_weights() is None, reason=f"the extra aliked is not installed: {INSTALL}")
def test_its_matches_fit_a_right_model_and_are_apart_from_sift(
    folder: SfmFolder, kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str]
):
    before = read_verified_pairs(folder.database, 15)
    said = ask_witness(Stages(folder, SfmSettings(threads=1), Monitor()), kermit_dir, kermit_names[:1])
    assert said is not None
    assert len(said.pairs) > 3
    keypoints = read_keypoints(folder.database, set(said.keypoints))
    assert all(len(keypoints[i]) != len(said.keypoints[i]) for i in keypoints)
    assert [len(pair.matches) for pair in read_verified_pairs(folder.database, 15)] == [
        len(pair.matches) for pair in before
    ]
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    checks = check_pairs(model, said.pairs, said.keypoints, relative_poses=False)
    assert sum(check.supported for check in checks) > 0.9 * sum(check.matches for check in checks)
