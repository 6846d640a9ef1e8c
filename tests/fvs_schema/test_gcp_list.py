from pathlib import Path

import pytest

from fvs_schema.control_points import ControlPoints
from fvs_schema.gcp_list import GcpListError, read_gcp_list

FILE = Path("gcp_list.txt")
CRS = "+proj=utm +zone=10 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"


def _read(*lines: str, check: tuple[str, ...] = ()) -> ControlPoints:
    return read_gcp_list("\n".join((CRS, *lines)), FILE, check)


def test_lines_of_one_point_are_its_marks() -> None:
    read = _read(
        "544256.7 5320919.9 5 3044.5 2622 IMG_0525.jpg a",
        "",
        "544157.7\t5320899.2\t5\t4193\t1552\tIMG 0585.jpg\tb",
        "544256.7 5320919.9 5.0 1606 2763 IMG_0690.jpg a extra1 extra2",
    )
    assert read.crs == CRS
    a, b = read.points
    assert (a.name, a.x, a.y, a.z, a.check) == ("a", 544256.7, 5320919.9, 5.0, False)
    assert [(mark.image, mark.x_px, mark.y_px) for mark in a.marks] == [
        ("IMG_0525.jpg", 3044.5, 2622.0),
        ("IMG_0690.jpg", 1606.0, 2763.0),
    ]
    assert [mark.image for mark in b.marks] == ["IMG 0585.jpg"]


def test_points_without_names_are_told_apart_by_their_coordinates() -> None:
    read = _read("1 2 NaN 0 0 a.jpg", "1 3 NaN 0 0 a.jpg", "1 2 NaN 4 0 b.jpg")
    assert [(point.name, point.z, len(point.marks)) for point in read.points] == [
        ("point-1", None, 2),
        ("point-2", None, 1),
    ]


def test_check_points_are_named_or_have_the_word_after_their_name() -> None:
    lines = ("1 1 1 0 0 a.jpg G1", "1 2 1 0 0 a.jpg C1", "1 3 1 0 0 a.jpg C2", "1 4 1 0 0 a.jpg G2 Check")
    checks = {point.name for point in _read(*lines, check=("C*",)).points if point.check}
    assert checks == {"C1", "C2", "G2"}


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("1 2 3 4 5",), "line 2: it has 5 columns"),
        (("gcp01 529356.2 9251137.5 8.4 1 a.jpg",), "geo_x is gcp01"),
        (("1,5 2 3 4 5 a.jpg",), "geo_x is 1,5"),
        (("1 nan 3 4 5 a.jpg",), "geo_y is nan"),
        (("1 2 3 -4 5 a.jpg",), "-4, 5 px"),
        (("1 2 3 4 5 a.jpg p", "1 2 4 4 5 b.jpg p"), "line 3: p has other coordinates than in line 2"),
        (("1 2 3 4 5 a.jpg p", "1 2 3 9 5 a.jpg p"), "p has a second mark in a.jpg"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(lines: tuple[str, ...], message: str) -> None:
    with pytest.raises(GcpListError) as raised:
        _read(*lines)
    assert message in raised.value.message
    assert str(FILE) in raised.value.message
    assert raised.value.hint


def test_an_empty_file_and_an_unknown_check_point() -> None:
    with pytest.raises(GcpListError, match="no points"):
        read_gcp_list("\n \n", FILE)
    with pytest.raises(GcpListError, match="named Z"):
        _read("1 2 3 4 5 a.jpg p", check=("Z*",))


@pytest.mark.parametrize("line", ["{0} 2 5 1 1 a.jpg", "1 2 5 1 1 {0}.jpg G1", "{0} 2 5 1 1 a.jpg G{0}"])
def test_long_files_are_read_in_one_pass(line: str) -> None:
    read = _read(*(line.format(number) for number in range(10_000)))
    assert sum(len(point.marks) for point in read.points) == 10_000
