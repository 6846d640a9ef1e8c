import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.scene.dataset import open_dataset


@pytest.fixture
def photographs(room_dir: Path, tmp_path: Path) -> Path:
    """A dataset of three photographs in ``images``, without poses."""
    folder = tmp_path / "data"
    (folder / "images").mkdir(parents=True)
    for path in sorted((room_dir / "images").iterdir())[:3]:
        shutil.copyfile(path, folder / "images" / path.name)
    return folder


def write_transforms(path: Path, names: list[str], at: float) -> None:
    """Cameras with all centres at x = ``at``."""
    matrix = np.eye(4)
    matrix[0, 3] = at
    frames = [{"file_path": f"images/{name}", "transform_matrix": matrix.tolist()} for name in names]
    camera = {"fl_x": 77, "fl_y": 77, "cx": 48, "cy": 36, "w": 96, "h": 72}
    path.write_text(json.dumps({**camera, "frames": frames}))


@pytest.mark.parametrize("place", ["sparse/0", "sparse", "reference", "0", "."])
def test_a_colmap_model_is_found_where_datasets_keep_it(
    photographs: Path, room_dir: Path, place: str
) -> None:
    shutil.copytree(room_dir / "sparse" / "0", photographs / place, dirs_exist_ok=True)
    dataset = open_dataset(photographs)
    assert dataset.names == ("00.png", "01.png", "02.png")
    assert dataset.image_dir == photographs / "images"
    assert dataset.points is not None


def test_photographs_may_lie_in_the_folder_itself(photographs: Path, room_dir: Path) -> None:
    shutil.copytree(room_dir / "sparse", photographs / "images" / "sparse")
    assert open_dataset(photographs / "images").names == ("00.png", "01.png", "02.png")


def test_transforms_come_first_and_named_poses_before_all(photographs: Path, room_dir: Path) -> None:
    names = ["00.png", "01.png", "02.png"]
    shutil.copytree(room_dir / "sparse", photographs / "sparse")
    write_transforms(photographs / "transforms.json", names, at=1.0)
    write_transforms(photographs / "other.json", names, at=2.0)
    assert open_dataset(photographs).views[0].centre[0] == 1.0
    assert open_dataset(photographs, transforms=photographs / "other.json").views[0].centre[0] == 2.0
    found = open_dataset(photographs, colmap=photographs / "sparse").views[0].centre
    assert found == pytest.approx([1.55, 0.0, 0.3])


def test_two_sources_and_none_are_refused(photographs: Path) -> None:
    with pytest.raises(InvalidInputError, match="one source"):
        open_dataset(photographs, Path("a"), Path("b"))
    with pytest.raises(InvalidInputError, match=r"neither transforms\.json nor a COLMAP model") as caught:
        open_dataset(photographs)
    assert "--colmap" in caught.value.hint
    with pytest.raises(InvalidInputError, match="does not exist"):
        open_dataset(photographs / "nowhere")
