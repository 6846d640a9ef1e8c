import os
import unicodedata
from pathlib import Path

import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.images.names import decoded_name, match_files, match_names, readable_name
from fvs_schema.findings import FindingCode

IMAGES = {"a/1.jpg": "a/1.jpg", "b/1.jpg": "b/1.jpg", "2.tif": "2.tif.png", "2.tif.png": "2.tif.png"}


def test_the_whole_path_decides_before_its_last_part() -> None:
    names = ["b/1.jpg", "./a/1.jpg"]
    assert match_names(names, IMAGES).found == {"b/1.jpg": "b/1.jpg", "./a/1.jpg": "a/1.jpg"}


def test_folders_may_differ_where_the_last_part_is_enough() -> None:
    assert match_names(["images/2.tif"], IMAGES).found == {"images/2.tif": "2.tif.png"}
    assert match_names(["1.jpg"], {"a/1.jpg": "a/1.jpg"}).found == {"1.jpg": "a/1.jpg"}


def test_what_could_mean_two_images_is_ambiguous() -> None:
    matches = match_names(["1.jpg", "c/1.jpg", "3.jpg"], IMAGES)
    both = ("a/1.jpg", "b/1.jpg")
    assert (matches.found, matches.missing) == ({}, ("3.jpg",))
    assert matches.ambiguous == {"1.jpg": both, "c/1.jpg": both}
    with pytest.raises(InvalidInputError, match=r"1\.jpg may mean a/1\.jpg or b/1\.jpg\."):
        matches.require_unambiguous()


def test_no_image_is_found_twice() -> None:
    matches = match_names(["2.tif", "x/2.tif.png"], IMAGES)
    assert matches.found == {"2.tif": "2.tif.png"}
    with pytest.raises(InvalidInputError, match=r"x/2\.tif\.png may mean 2\.tif\.png, and so may 2\.tif\."):
        matches.require_unambiguous()
    twice = match_names(["x/2.tif", "y/2.tif"], IMAGES)
    assert (twice.found, set(twice.ambiguous)) == ({}, {"x/2.tif", "y/2.tif"})


def test_files_are_found_below_a_folder(tmp_path: Path) -> None:
    (tmp_path / "left").mkdir()
    for name in ("1.jpg", "left/2.jpg", ".hidden.jpg"):
        (tmp_path / name).touch()
    matches = match_files(["images/1.jpg", "2.jpg", "3.jpg", ".hidden.jpg"], tmp_path)
    assert matches.found == {"images/1.jpg": "1.jpg", "2.jpg": "left/2.jpg"}
    assert matches.missing == ("3.jpg", ".hidden.jpg")
    with pytest.raises(InvalidInputError, match=r"and so may 1\.jpg"):
        match_files(["1.jpg", "images/1.jpg"], tmp_path)


@pytest.mark.parametrize(
    ("name", "images", "expected"),
    [
        ("left\\1.jpg", ["left/1.jpg", "right/1.jpg"], "left/1.jpg"),
        ("LEFT/1.jpg", ["left/1.jpg", "right/1.jpg"], "left/1.jpg"),
        (
            unicodedata.normalize("NFC", "Gebäude/ö.jpg"),
            [unicodedata.normalize("NFD", "Gebäude/ö.jpg")],
            None,
        ),
        ("IMG_1.JPG", ["img_1.jpg"], None),
        ("a.jpeg", ["b.jpg", "a.jpg"], "a.jpg"),
        ("images/a.png", ["a.jpg"], None),
        ("images/0001", ["0001.jpg", "0001.json"], "0001.jpg"),
        ("frame.0001", ["frame.0002.jpg", "frame.0001.jpg"], "frame.0001.jpg"),
        (decoded_name("left\\照片.jpg".encode("gbk")), ["left/照片.jpg"], None),
        (decoded_name("乗.jpg".encode("cp932")), ["乗.jpg"], None),  # its second byte is ASCII
        (decoded_name("一.jpg".encode("gbk")), ["一.jpg"], None),  # which is UTF-8, of another letter
        (decoded_name("Käse.jpg".encode("latin-1")), ["Käse.jpg"], None),
        (decoded_name("Käse.jpg".encode("latin-1")), [os.fsdecode("Käse.jpg".encode("latin-1"))], None),
        ("Käse.jpg", [os.fsdecode("Käse.jpg".encode("latin-1"))], None),
    ],
)
def test_other_spellings_mean_the_same_image(name: str, images: list[str], expected: str | None) -> None:
    matches = match_names([name], {image: image for image in images})
    found = expected or images[0]
    assert matches.found == {name: found}
    assert matches.respelled == (name,)
    (finding,) = matches.findings()
    assert (finding.code, finding.images) == (FindingCode.NAMES_RESPELLED, (readable_name(found),))
    assert finding.texts == {"name": name, "image": readable_name(found)}


@pytest.mark.parametrize(
    ("names", "images"),
    [
        (["a.tif"], ["a.jpg", "a.png"]),
        (["a.jpg", "a.png"], ["a.jpg"]),
        (["x/a.tif", "y/a.bmp"], ["a.jpg"]),
        (["a.jpg"], ["a.json"]),
        (["img.0001"], ["img.jpg"]),
    ],
)
def test_where_two_can_be_meant_none_is_taken(names: list[str], images: list[str]) -> None:
    matches = match_names(names, {image: image for image in images})
    assert matches.findings() == ()
    assert set(matches.missing) == set(names) - set(images)
    assert matches.ambiguous == {}


def test_the_nearest_spelling_is_taken() -> None:
    images = ["A.jpg", "a.JPG", "sub/b.png", "b.jpg"]
    matches = match_names(["a.jpg", "b.PNG"], {image: image for image in images})
    assert matches.ambiguous == {"a.jpg": ("A.jpg", "a.JPG")}
    assert matches.found == {"b.PNG": "sub/b.png"}
