from fvs_engine.pipeline.names import match_names

KNOWN = {"a/1.jpg": "a/1.jpg", "b/1.jpg": "b/1.jpg", "2.tif": "2.tif.png", "2.tif.png": "2.tif.png"}


def test_the_whole_name_decides_before_its_last_part() -> None:
    assert match_names(["b/1.jpg", "a/1.jpg"], KNOWN) == {"b/1.jpg": "b/1.jpg", "a/1.jpg": "a/1.jpg"}


def test_folders_may_differ_where_the_last_part_is_enough() -> None:
    assert match_names(["images/2.tif"], KNOWN) == {"images/2.tif": "2.tif.png"}
    assert match_names(["1.jpg"], {"a/1.jpg": "a/1.jpg"}) == {"1.jpg": "a/1.jpg"}


def test_what_could_mean_two_photographs_means_none() -> None:
    assert match_names(["1.jpg", "c/1.jpg", "3.jpg"], KNOWN) == {}
    assert match_names(["x/2.tif", "y/2.tif"], KNOWN) == {}


def test_no_photograph_is_meant_twice() -> None:
    assert match_names(["2.tif", "x/2.tif.png"], KNOWN) == {"2.tif": "2.tif.png"}
