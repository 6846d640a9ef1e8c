from pathlib import Path

import numpy as np
import pytest

from fvs_engine.export.points_ply import read_positions, write_points
from fvs_engine.sfm.reconstruction import PointCloud

CLOUD = PointCloud(
    np.array([[0.5, -1.25, 3.0], [1e3, 2.0, -4.0]]), np.array([[255, 0, 7], [1, 2, 3]], dtype=np.uint8)
)


def test_points_are_written_in_the_layout_that_viewers_read(tmp_path: Path) -> None:
    write_points(tmp_path / "points.ply", CLOUD)
    header, _, content = (tmp_path / "points.ply").read_bytes().partition(b"end_header\n")
    assert header.decode().split("\n")[:-1] == [
        *("ply", "format binary_little_endian 1.0", "element vertex 2"),
        *(f"property float {name}" for name in ("x", "y", "z")),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
    ]
    assert len(content) == 2 * 15
    assert np.frombuffer(content, "<f4", 3).tolist() == [0.5, -1.25, 3.0]
    assert [*content[12:15], *content[27:]] == [255, 0, 7, 1, 2, 3]


@pytest.mark.parametrize("cloud", [CLOUD, PointCloud.empty()])
def test_positions_are_read_again(cloud: PointCloud, tmp_path: Path) -> None:
    write_points(tmp_path / "points.ply", cloud)
    assert np.array_equal(read_positions(tmp_path / "points.ply"), cloud.xyz)
