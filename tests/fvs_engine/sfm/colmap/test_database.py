import contextlib
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from fvs_engine.errors import DamagedOutputError
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import (
    count_rows,
    image_cameras,
    image_ids,
    read_verified_pairs,
    require_sound_database,
    restore_pairs,
    verified_matches,
    veto_pairs,
)
from fvs_engine.sfm.matching.match import match_pairs
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages


@pytest.mark.parametrize("tables", [(), ("cameras",), ("cameras", "images")])
def test_a_database_whose_creation_was_interrupted_is_created_again(
    tables: tuple[str, ...], tmp_path: Path
) -> None:
    path = tmp_path / "database.db"
    path.touch()
    connection = sqlite3.connect(path)
    for table in tables:
        connection.execute(f"CREATE TABLE {table} (name TEXT)")
    connection.commit()
    connection.close()
    require_sound_database(path)
    assert not path.exists()
    assert image_cameras(path) == {}


def test_a_whole_database_is_left_alone(
    kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "database.db"
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", path)
    require_sound_database(path)
    assert sorted(image_cameras(path)) == kermit_names


def test_a_database_that_is_damaged_while_it_is_used_is_named(tmp_path: Path) -> None:
    path = tmp_path / "database.db"
    path.write_bytes(b"no database" * 1000)
    with pytest.raises(DamagedOutputError, match=r"database\.db is damaged"):
        image_ids(path)
    assert count_rows(path, "images") == 0


@pytest.mark.usefixtures("native_here")
def test_vetoed_pairs_are_not_verified_until_they_are_restored(
    kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "database.db"
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", path)
    before, ids = verified_matches(path, 15), image_ids(path)
    pairs = list(before)[:2]
    stages = Stages(SfmFolder(tmp_path), tmp_path, SfmSettings(), Monitor())
    veto_pairs(path, [(ids[first], ids[second])[::-1] for first, second in pairs])
    assert verified_matches(path, 15).keys() == before.keys() - set(pairs)
    match_pairs(stages, pairs)  # matching them again changes nothing
    assert verified_matches(path, 15).keys() == before.keys() - set(pairs)
    assert restore_pairs(path) == pairs
    assert restore_pairs(path) == pairs  # also after a kill before they were matched
    match_pairs(stages, pairs)
    assert verified_matches(path, 15) == before
    assert restore_pairs(path) == []
    assert set(ids) == set(kermit_names)


def test_pairs_in_which_colmap_saw_a_watermark_are_not_restored(
    kermit_sfm: SfmResult, tmp_path: Path
) -> None:
    """They have the same configuration as vetoed pairs, and keep their matches."""
    path = tmp_path / "database.db"
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", path)
    with contextlib.closing(sqlite3.connect(path)) as db, db:
        watermark = int(pycolmap.TwoViewGeometryConfiguration.WATERMARK)
        db.execute("UPDATE two_view_geometries SET config = ? WHERE rows >= 100", (watermark,))
    assert restore_pairs(path) == []


def test_the_pairs_around_an_image_are_those_of_its_neighbours(
    kermit_sfm: SfmResult, kermit_names: list[str]
) -> None:
    path = kermit_sfm.model_dir.parent / "database.db"
    pairs, ids = read_verified_pairs(path, 15), image_ids(path)
    centre = ids[kermit_names[0]]
    near = {i for pair in pairs if centre in (pair.first, pair.second) for i in (pair.first, pair.second)}
    assert 2 < len(near) < len(ids)
    around = read_verified_pairs(path, 15, around=kermit_names[:1])
    expected = [pair for pair in pairs if {pair.first, pair.second} <= near]
    assert [(pair.first, pair.second) for pair in around] == [(pair.first, pair.second) for pair in expected]
    assert all(np.array_equal(a.matches, b.matches) for a, b in zip(around, expected, strict=True))
    assert read_verified_pairs(path, 15, around=["unknown.jpg"]) == []
