import json
from pathlib import Path

import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.sfm.colmap.intrinsics import read_intrinsics
from fvs_engine.sfm.settings import KnownIntrinsics

CAMERA = KnownIntrinsics(model="PINHOLE", width_px=640, height_px=480, params=(700.5, 701.0, 320.0, 240.0))


@pytest.mark.parametrize(
    "content",
    [
        "1 PINHOLE 640 480 700.5 701 320 240",
        "# Camera list\n# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n\n3 PINHOLE 640 480 700.5 701 320 240\n",
        '\n{"model": "PINHOLE", "width_px": 640, "height_px": 480, "params": [700.5, 701, 320, 240]}',
    ],
)
def test_the_same_camera_in_every_format(content: str, tmp_path: Path) -> None:
    file = tmp_path / "cameras.txt"
    file.write_text(content)
    assert read_intrinsics(file) == CAMERA


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "0 cameras"),
        ("1 PINHOLE 640 480 7 7 3 2\n2 PINHOLE 640 480 7 7 3 2\n", "2 cameras"),
        ("1 PINHOLE", "width_px"),
        ("1 PINHOLE 640 480.5 7 7 3 2", "height_px"),
        ("1 PINHOLE 640 480 7 seven 3 2", r"params\.1"),
        ("1 PINHOLE 640 480 7 7 3 nan", r"params\.3.*finite"),
        ("1 PINHOLE 640 480 7 7 3", "4 parameters, not 3"),
        ("1 PINHOLE 640 480 -7 7 3 2", "positive"),
        ("1 THIN_PRISM_FISHEYE 640 480 7", "THIN_PRISM_FISHEYE.*not known"),
        ("{", "not JSON"),
        (json.dumps({"model": "PINHOLE", "params": [7, 7, 3, 2]}), "width_px"),
        (json.dumps(CAMERA.model_dump() | {"f": 1}), "f: there is no such field"),
        ("\udcff", "not a text file"),
    ],
)
def test_what_is_no_camera_is_named_with_an_example(content: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "cameras.txt"
    file.write_bytes(content.encode("utf-8", "surrogateescape"))
    with pytest.raises(InvalidInputError, match=message) as caught:
        read_intrinsics(file)
    assert str(file) in caught.value.message
    assert caught.value.hint


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"none\.txt cannot be read"):
        read_intrinsics(tmp_path / "none.txt")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
@pytest.mark.parametrize(
    "content", ["# Camera list\r\n1 PINHOLE 640 480 700.5 701 320 240\r\n", CAMERA.model_dump_json()]
)
def test_a_byte_order_mark_is_no_camera(encoding: str, content: str, tmp_path: Path) -> None:
    file = tmp_path / "cameras.txt"
    file.write_bytes(content.encode(encoding))
    assert read_intrinsics(file) == CAMERA
