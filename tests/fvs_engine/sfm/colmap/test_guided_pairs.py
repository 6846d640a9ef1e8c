"""Guided pairs in a database, and the pairs that they replace."""

import contextlib
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import image_ids, pair_number, remove_images, verified_matches
from fvs_engine.sfm.colmap.guided_pairs import take_back_guided_pairs, write_guided_pairs


@pytest.fixture
def database(kermit_sfm: SfmResult, tmp_path: Path) -> Path:
    return Path(shutil.copy(kermit_sfm.model_dir.parent / "database.db", tmp_path / "database.db"))


def rows(database: Path) -> dict[int, tuple[object, ...]]:
    with contextlib.closing(sqlite3.connect(database)) as db:
        return {row[0]: row for row in db.execute("SELECT * FROM two_view_geometries")}


def write(database: Path, first: str, second: str) -> int:
    """Write a pair of 20 guided matches; its number."""
    ids = image_ids(database)
    low, high = sorted((ids[first], ids[second]))
    geometry = pycolmap.TwoViewGeometry()
    geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
    geometry.inlier_matches = np.repeat(np.arange(20, dtype=np.uint32)[:, None], 2, axis=1)
    write_guided_pairs(database, {(low, high): geometry})
    return pair_number(low, high)


def test_guided_pairs_of_registered_images_stay(database: Path, kermit_names: list[str]):
    first, second = kermit_names[:2]
    number = write(database, first, second)
    guided = rows(database)[number]
    assert {first, second} in [
        set(pair) for pair, count in verified_matches(database, 15).items() if count == 20
    ]
    take_back_guided_pairs(database, kermit_names)
    assert rows(database)[number] == guided


def test_what_a_guided_pair_replaced_is_put_back(database: Path, kermit_names: list[str]):
    before = rows(database)
    write(database, kermit_names[0], kermit_names[1])
    assert rows(database) != before
    for _ in range(2):  # as after a kill
        take_back_guided_pairs(database, kermit_names[1:])
        assert rows(database) == before


def test_a_pair_that_was_not_there_is_gone(database: Path, kermit_names: list[str]):
    number = write(database, kermit_names[0], kermit_names[1])
    take_back_guided_pairs(database, ())
    with contextlib.closing(sqlite3.connect(database)) as db, db:
        db.execute("DELETE FROM two_view_geometries WHERE pair_id = ?", (number,))
    write(database, kermit_names[0], kermit_names[1])
    assert number in rows(database)
    take_back_guided_pairs(database, ())
    assert number not in rows(database)


def test_pairs_of_an_image_that_was_removed_do_not_come_back(database: Path, kermit_names: list[str]):
    number = write(database, kermit_names[0], kermit_names[1])
    remove_images(database, [kermit_names[0]])
    take_back_guided_pairs(database, kermit_names[1:])
    assert number not in rows(database)


def test_without_guided_pairs_nothing_changes(database: Path):
    before = rows(database)
    take_back_guided_pairs(database, ())
    assert rows(database) == before
