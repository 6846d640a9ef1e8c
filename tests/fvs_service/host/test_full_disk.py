"""A disk that is really full: a small file system in memory, where this machine lets us mount one."""

import contextlib
import os
import shutil
import sqlite3
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fvs_service.errors import OutOfSpaceError
from fvs_service.storage.database import Database
from fvs_service.storage.tables import TenantRow

pytestmark = pytest.mark.process

_MEGABYTE = 1_000_000


@contextlib.contextmanager
def _small_disk(folder: Path, megabytes: int) -> Iterator[Path]:
    folder.mkdir()
    mounted = shutil.which("mount") and subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "none", str(folder)],
        check=False,
        capture_output=True,
    )
    if not mounted or mounted.returncode != 0:
        pytest.skip("a file system of a few MB cannot be mounted here: that needs root")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def _fill(folder: Path, leave_bytes: int) -> Path:
    """A file that leaves so much room."""
    file = folder / "filling"
    with file.open("wb") as out, contextlib.suppress(OSError):
        os.posix_fallocate(out.fileno(), 0, max(1, shutil.disk_usage(folder).free - leave_bytes))
    return file


def _add_tenant(database: Database, tenant: str) -> OutOfSpaceError | None:
    try:
        with database.writing() as session:
            session.add(TenantRow(id=tenant, served_at_ms=0))
    except OutOfSpaceError as error:
        return error
    return None


def test_the_database_refuses_writes_on_a_full_disk_and_is_whole_afterwards(tmp_path: Path) -> None:
    with _small_disk(tmp_path / "disk", 4) as disk:
        database = Database(f"sqlite:///{disk / 'fvs.sqlite3'}")
        database.migrate()
        filling = _fill(disk, 0)
        written, refused = 0, None
        while refused is None:
            refused = _add_tenant(database, f"{written:064d}")
            written += refused is None
        assert str(disk) not in refused.message + refused.hint
        with database.reading() as session:
            assert session.query(TenantRow).count() == written
        filling.unlink()
        assert _add_tenant(database, "after") is None
        database.close()
        with contextlib.closing(sqlite3.connect(disk / "fvs.sqlite3")) as connection:
            assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_service_on_a_full_disk_refuses_waits_and_goes_on(
    serving: Any, courtyard_photographs: list[Path], tmp_path: Path
) -> None:
    settings = {
        "FVS_RESERVE_BYTES": str(8 * _MEGABYTE),
        "FVS_LIMITS__IMAGE_BYTES": str(4 * _MEGABYTE),
    }
    with _small_disk(tmp_path / "disk", 300) as disk, serving(disk / "root", settings) as service:
        scene = service.scene()
        service.send(scene, courtyard_photographs[:7])
        job = service.start(scene, iterations=600)
        service.wait(job, lambda found: found["stage"] in ("quick-training", "training"))
        filling = _fill(disk, 5 * _MEGABYTE)  # into the reserve
        paused = service.wait(job, lambda found: found["waiting"] is not None)
        assert (paused["state"], paused["waiting"]["reason"]) == ("running", "disk")
        content = courtyard_photographs[8].read_bytes()
        refused = service.client.post(f"/v1/scenes/{scene}/images", files={"files": ("a.jpg", content)})
        assert (refused.status_code, refused.json()["code"]) == (507, "out-of-space")
        other = service.start(service.scene())
        # Workers say with their heartbeats that they take no jobs.
        waiting = service.wait(other, lambda found: found["waiting"]["reason"] == "disk")
        assert waiting["state"] == "queued"
        for text in (refused.text, str(paused), str(waiting)):
            assert str(disk) not in text
        filling.unlink()
        assert service.finish(job)["attempt"] == 1
        service.send(scene, courtyard_photographs[8:9])
