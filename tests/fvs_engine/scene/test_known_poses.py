import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import ReconstructionError
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset, open_dataset, read_dataset
from fvs_engine.scene.known_poses import KnownPoses
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.sfm.settings import FeatureSettings, SfmSettings

pytestmark = pytest.mark.usefixtures("all_native_here")

SETTINGS = SfmSettings(features_of_few=FeatureSettings(max_features=1500))
VISITED = ("0003.jpg", "0001.jpg", "0002.jpg")


@pytest.fixture
def yard(yard_dir: Path) -> Dataset:
    """Small photographs with true poses, without points."""
    return open_dataset(yard_dir)


def test_points_are_those_that_two_visited_views_saw(tmp_path: Path, ball: Dataset) -> None:
    source = KnownPoses(tmp_path / "sfm", ball, SETTINGS)
    current = source.update(("3.png", "0.png", "1.png"), (), Monitor())
    assert [view.name for view in current.views] == ["3.png", "0.png", "1.png"]
    centres = np.stack([view.centre for view in current.views])
    assert ball.points is not None
    expected = ((ball.points.cloud.xyz @ centres.T > 0).sum(axis=1) >= 2).sum()
    assert 0 < len(current.points) == expected < len(ball.points)
    assert not (tmp_path / "sfm").exists()
    assert source.localise(["7.png"], Monitor())["7.png"].camera == ball.by_name["7.png"].camera


@pytest.mark.system
def test_points_are_triangulated_where_the_dataset_has_none(tmp_path: Path, yard: Dataset) -> None:
    source = KnownPoses(tmp_path / "sfm", yard, SETTINGS)
    assert len(source.update(VISITED[:1], (), Monitor()).points) == 0
    two = source.update(VISITED[:2], (), Monitor())
    three = source.update(VISITED, (), Monitor())
    assert 20 < len(two.points) < len(three.points)
    assert (three.points.colors.std(axis=0) > 5).all()
    for view in three.views:
        assert np.array_equal(view.camera_from_model.matrix, yard.by_name[view.name].camera_from_model.matrix)
        in_front = view.camera_from_model.apply(three.points.xyz)[:, 2] > 0
        assert in_front.all()


def test_photographs_that_lack_the_colours_of_their_points_are_refused(
    tmp_path: Path, room_dir: Path
) -> None:
    room = read_dataset(room_dir / "images", colmap=room_dir / "sparse")
    first = room.names[:4]
    assert len(KnownPoses(tmp_path / "sfm", room, SETTINGS).update(first, (), Monitor()).points) > 30
    others = tmp_path / "others"
    others.mkdir()
    for name, other in zip(room.names, room.names[5:] + room.names[:5], strict=True):
        shutil.copyfile(room.image_dir / other, others / name)
    mistaken = KnownPoses(tmp_path / "sfm", replace(room, image_dir=others), SETTINGS)
    with pytest.raises(ReconstructionError, match=r"contradict its photographs: .* other colours"):
        mistaken.update(first, (), Monitor())
    assert room.points is not None
    colorless = PointCloud(room.points.cloud.xyz, 0 * room.points.cloud.colors)
    plain = replace(room, image_dir=others, points=replace(room.points, cloud=colorless))
    assert len(KnownPoses(tmp_path / "sfm", plain, SETTINGS).update(first, (), Monitor()).views) == 4


def test_poses_of_other_photographs_are_refused(tmp_path: Path, yard: Dataset) -> None:
    names = [view.name for view in yard.views]
    swapped = tuple(
        replace(yard.by_name[name], name=other)
        for name, other in zip(names, names[5:] + names[:5], strict=True)
    )
    source = KnownPoses(tmp_path / "sfm", replace(yard, views=swapped), SETTINGS)
    with pytest.raises(ReconstructionError, match="given poses of yard contradict"):
        source.update(VISITED, (), Monitor())


@pytest.mark.system
def test_photographs_without_texture_are_named(tmp_path: Path, yard: Dataset) -> None:
    bare = shutil.copytree(yard.image_dir, tmp_path / "bare")
    for name in VISITED:
        Image.new("RGB", (320, 240), (200, 190, 180)).save(bare / name)
    with pytest.raises(ReconstructionError, match="3 of 3 images have no texture"):
        KnownPoses(tmp_path / "sfm", replace(yard, image_dir=bare), SETTINGS).update(VISITED, (), Monitor())
