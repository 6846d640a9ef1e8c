import shutil
import sqlite3
from pathlib import Path

import pytest

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import (
    image_cameras,
    image_ids,
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


@pytest.mark.usefixtures("native_here")
def test_vetoed_pairs_are_not_verified_until_they_are_restored(
    kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "database.db"
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", path)
    before, ids = verified_matches(path, 15), image_ids(path)
    pairs = list(before)[:2]
    stages = Stages(SfmFolder(tmp_path), SfmSettings(), Monitor())
    veto_pairs(path, [(ids[first], ids[second])[::-1] for first, second in pairs])
    assert verified_matches(path, 15).keys() == before.keys() - set(pairs)
    match_pairs(stages, pairs)  # matching them again changes nothing
    assert verified_matches(path, 15).keys() == before.keys() - set(pairs)
    assert restore_pairs(path) == pairs
    match_pairs(stages, pairs)
    assert verified_matches(path, 15) == before
    assert restore_pairs(path) == []
    assert set(ids) == set(kermit_names)
