from pathlib import Path

import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.images.names import match_files, match_names

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
