import contextlib
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.matching import match
from fvs_engine.sfm.native import matching as native_matching
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages


def test_pairs_of_a_large_set_are_selected_by_the_priors_of_the_request(
    kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    passed: list[Mapping[int, Any]] = []

    def selected(_count: int, _descriptors: Any, positions: Mapping[int, Any]) -> list[tuple[int, int]]:
        passed.append(positions)
        return []

    monkeypatch.setattr(match, "selected_pairs", selected)
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", tmp_path / "database.db")
    stages = Stages(SfmFolder(tmp_path), tmp_path, SfmSettings(exhaustive_up_to=2), Monitor())
    priors = PosePriors(by_name={kermit_names[2]: PosePrior.at(np.array([1.0, 2.0, 3.0]))})
    match.match_features(stages, kermit_names, priors)
    match.match_features(stages, kermit_names)
    (given, in_exif) = passed
    assert {index: place.tolist() for index, place in given.items()} == {2: [1.0, 2.0, 3.0]}
    assert 2 not in in_exif or in_exif[2].tolist() != [1.0, 2.0, 3.0]


MATCHES = "SELECT pair_id, rows, data FROM matches ORDER BY pair_id"
GEOMETRIES = "SELECT pair_id, rows, config, data, F, E FROM two_view_geometries ORDER BY pair_id"


@pytest.fixture
def unmatched(kermit_sfm: SfmResult, tmp_path: Path) -> Stages:
    """A folder with features and without matches; one photograph has white space in its name."""
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", tmp_path / "database.db")
    with contextlib.closing(sqlite3.connect(tmp_path / "database.db")) as db, db:
        db.execute("DELETE FROM matches")
        db.execute("DELETE FROM two_view_geometries")
        db.execute("UPDATE images SET name = 'two words.jpg' WHERE name = 'kermit001.jpg'")
    return Stages(SfmFolder(tmp_path), tmp_path, SfmSettings(threads=3), Monitor())


def rows(database: Path, query: str) -> list[Any]:
    with contextlib.closing(sqlite3.connect(database)) as db:
        return db.execute(query).fetchall()


def test_several_processes_find_what_one_finds(
    kermit_sfm: SfmResult, kermit_names: list[str], unmatched: Stages, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(match, "_BATCH", 10)  # two batches of thirty pairs
    counted: list[int] = []
    monkeypatch.setattr(unmatched, "monitor", Monitor(lambda progress: counted.append(progress.done)))
    names = [name.replace("kermit001", "two words") for name in kermit_names]
    match.match_features(unmatched, names)
    found, expected = unmatched.folder.database, kermit_sfm.model_dir.parent / "database.db"
    assert len(rows(found, MATCHES)) == 55
    assert rows(found, MATCHES) == rows(expected, MATCHES)  # by one process, in this fixture
    assert rows(found, GEOMETRIES) == rows(expected, GEOMETRIES)
    assert counted[-1] == 55
    assert not unmatched.folder.parts.exists()


def test_pairs_that_lost_their_geometry_keep_their_matches(unmatched: Stages, kermit_names: list[str]):
    pair = (kermit_names[0], kermit_names[2])
    match.match_pairs(unmatched, [pair])
    database = unmatched.folder.database
    with contextlib.closing(sqlite3.connect(database)) as db, db:
        db.execute("DELETE FROM two_view_geometries")
        db.execute("UPDATE matches SET rows = rows - 20, data = substr(data, 1, length(data) - 160)")
    (kept,) = rows(database, MATCHES)
    match.match_pairs(unmatched, [pair])
    assert rows(database, MATCHES) == [kept]
    assert len(rows(database, GEOMETRIES)) == 1


@pytest.mark.process
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_a_process_that_crashes_ends_the_job_and_the_other_processes(number: int, tmp_path: Path):
    script = f"""
import os, signal, time
from pathlib import Path
from fvs_engine.sfm.native import matching

class Crashing:
    def match(self, seed): os.kill(os.getpid(), {int(number)})

class Waiting:
    def match(self, seed):
        Path({str(tmp_path / "pid")!r}).write_text(str(os.getpid()))
        time.sleep(600)

try:
    matching._match_all([Waiting(), Crashing()], 0)
except RuntimeError:
    os._exit(7)
"""
    job = subprocess.run([sys.executable, "-c", script], capture_output=True, timeout=60, check=False)
    assert job.returncode == -number


@pytest.mark.usefixtures("native_here")
def test_a_folder_of_parts_that_cannot_be_removed_stops_nothing(
    unmatched: Stages, kermit_names: list[str], monkeypatch: pytest.MonkeyPatch
):
    """Whoever counts the matches of a part that is being removed leaves SQLite's files in its folder."""
    names = [name for name in kermit_names if name != "kermit001.jpg"][:4]
    monkeypatch.setattr(native_matching.shutil, "rmtree", lambda *_, **__: None)
    monkeypatch.setattr(match, "_BATCH", 2)
    unmatched.folder.parts.mkdir()
    unmatched.folder.parts.joinpath("0-0.db").write_bytes(b"of a run that was killed")
    single = Stages(unmatched.folder, unmatched.image_dir, SfmSettings(threads=1), Monitor())
    pairs = [(first, second) for first in names for second in names if first < second]
    match.match_pairs(single, pairs)
    assert len(rows(unmatched.folder.database, GEOMETRIES)) == len(pairs)
    assert list(unmatched.folder.parts.glob("*.db*")) == []
