"""A PostgreSQL database has the workers of one ``fvs serve``."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from uuid import uuid4

import httpx2
import pytest
from fvs_service.application import open_storage
from fvs_service.host.worker.heartbeat import Heartbeats
from fvs_service.jobs.fleet import workers_of
from fvs_service.settings import Settings
from postgresql_server import PostgresqlServer
from typer.testing import CliRunner

from fvs_engine.cli.app import app

_START_S = 60
PROGRAM = str(Path(sys.executable).with_name("fvs"))


def _workers(settings: Settings) -> list[str]:
    with open_storage(settings) as storage, storage.database.reading() as session:
        return [worker.id for worker in workers_of(session)]


@pytest.mark.system
@pytest.mark.process
def test_a_second_service_is_refused_while_the_workers_of_the_first_are_alive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, postgresql: PostgresqlServer
) -> None:
    monkeypatch.setenv("FVS_DATABASE_URL", postgresql.create_database(uuid4().hex))
    settings = Settings(root=tmp_path / "first")
    with open_storage(settings) as storage:
        for worker in ("worker-0", "worker-7"):  # of an earlier start, which was killed a moment ago
            Heartbeats(storage.database, worker).beat()
    command = [PROGRAM, "serve", "--root", str(settings.root), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout is not None
        try:
            address = first.stdout.readline().strip()
            until = time.monotonic() + _START_S
            while httpx2.get(f"{address}/readyz?workers=1", timeout=10).status_code != 200:
                assert time.monotonic() < until
                time.sleep(0.1)
            assert _workers(settings) == ["worker-0"]
            refused = CliRunner().invoke(app, ["serve", "--root", str(tmp_path / "second"), "--port", "0"])
            assert refused.exit_code == 2
            assert "Another fvs serve runs workers on this database" in refused.stderr
            assert "FVS_CLUSTER" in refused.stderr
        finally:
            first.send_signal(signal.SIGTERM)
        assert first.wait(30) == 0
    assert _workers(settings) == []  # the next start waits for nobody


@pytest.mark.system
@pytest.mark.process
def test_a_service_ends_with_the_reason_when_another_one_has_become_its_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, postgresql: PostgresqlServer
) -> None:
    """As a frozen one does that wakes."""
    monkeypatch.setenv("FVS_DATABASE_URL", postgresql.create_database(uuid4().hex))
    settings = Settings(root=tmp_path / "first")
    command = [PROGRAM, "serve", "--root", str(settings.root), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as service:
        assert service.stdout is not None
        assert service.stderr is not None
        service.stdout.readline()
        until = time.monotonic() + _START_S
        while _workers(settings) != ["worker-0"]:
            assert time.monotonic() < until
            time.sleep(0.1)
        with open_storage(settings) as storage:
            Heartbeats(storage.database, "worker-0").beat()
        assert service.wait(30) == 2
        assert "Another fvs serve runs the worker worker-0 on this database now." in service.stderr.read()
