import json
from pathlib import Path

import numpy as np
import pytest
import typer
from fvs_client import FramePose, VehiclePose
from fvs_client.cli.poses import read_candidates, read_volume
from hypothesis import assume, given
from hypothesis import strategies as st

from fvs_engine.geometry import look_at, matrix_from_quaternion

coordinates = st.floats(-100, 100)
places = st.tuples(coordinates, coordinates, coordinates)


@given(position=places, target=places)
def test_looking_at_agrees_with_the_engine(
    position: tuple[float, float, float], target: tuple[float, float, float]
) -> None:
    forward = np.subtract(target, position)
    assume(np.linalg.norm(forward) > 1e-3 and np.linalg.norm(forward[:2]) > 1e-2 * np.linalg.norm(forward))
    pose = FramePose.looking_at(position, target)
    expected = look_at(position, target, [0, 0, 1])
    np.testing.assert_allclose(matrix_from_quaternion(pose.orientation_wxyz), expected.rotation, atol=1e-9)
    assert pose.position == position
    assert pose.orientation_wxyz[0] >= 0


def test_looking_nowhere_is_refused() -> None:
    with pytest.raises(ValueError, match="is at its target"):
        FramePose.looking_at((1, 2, 3), (1, 2, 3))
    with pytest.raises(ValueError, match="looks along"):
        FramePose.looking_at((1, 2, 3), (1, 2, 0))


def test_poses_are_checked() -> None:
    with pytest.raises(ValueError, match="orientation_wxyz: a unit quaternion"):
        FramePose(position=(0, 0, 0), orientation_wxyz=(1, 1, 0, 0))
    with pytest.raises(ValueError, match="`latitude_deg` must be a finite number"):
        VehiclePose(latitude_deg=float("nan"), longitude_deg=0, altitude_m=0, yaw_deg=0, pitch_deg=0)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_candidates_and_volumes_are_read_in_the_encodings_of_windows(encoding: str, tmp_path: Path) -> None:
    file = tmp_path / "given.json"
    box = {"kind": "box", "centre": [0, 0, 1], "size": [1, 1, 1]}
    pose = {"position": [0, 0, 0], "orientation_wxyz": [1, 0, 0, 0]}
    for read, document in ((read_volume, box), (read_candidates, [{"id": "left", "pose": pose}])):
        file.write_bytes(json.dumps(document).encode(encoding))
        assert read(file)
    file.write_bytes(b"\xff\xfe[")
    with pytest.raises(typer.BadParameter, match="is no JSON"):
        read_candidates(file)
