import shutil
import sqlite3
from pathlib import Path

import pytest

from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import image_cameras, require_sound_database


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
