"""Commands of the operator: those that only look change nothing, and what fails has a message and a hint."""

from datetime import datetime
from pathlib import Path

import pytest
from fvs_service.application import open_storage
from fvs_service.errors import IncompatibleDatabaseError, StorageUnavailableError
from fvs_service.scenes import repository
from fvs_service.settings import Settings
from fvs_service.storage import database as database_module
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.clock import now
from sqlalchemy import text
from typer.testing import CliRunner, Result

from fvs_engine.cli.app import app
from fvs_schema.scenes import SceneRequest

_LOOKING = (("doctor",), ("keys", "list"), ("keys", "revoke", "0" * 16))


def _fvs(*words: str) -> Result:
    return CliRunner().invoke(app, words)


def _status(words: tuple[str, ...]) -> int:
    return 13 if words[0] == "doctor" else 2


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """The root of a service that has run."""
    with open_storage(Settings(root=tmp_path / "service")) as storage:
        return storage.settings.root


def _state(root: Path) -> dict[str, bytes]:
    """The files below a folder; the database's without the log beside it."""
    files = (file for file in root.rglob("*") if not file.name.endswith(("-wal", "-shm")))
    return {str(file): file.read_bytes() if file.is_file() else b"" for file in files}


@pytest.mark.parametrize("words", _LOOKING)
@pytest.mark.parametrize("missing", ["", "fvs.sqlite3", "blobs"])
def test_what_only_looks_creates_nothing(words: tuple[str, ...], missing: str, root: Path) -> None:
    if missing:
        path = root / missing
        path.unlink() if path.is_file() else path.rmdir()
    folder = root if missing else root.parent / "typo"
    before = _state(root.parent)
    refused = _fvs(*words, "--root", str(folder))
    assert refused.exit_code == _status(words)
    assert "does not exist" in refused.stderr
    assert "--root" in refused.stderr
    assert _state(root.parent) == before


@pytest.mark.parametrize("words", _LOOKING)
def test_what_only_looks_does_not_migrate(
    words: tuple[str, ...], root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = database_module.KNOWN_VERSIONS[-1]
    monkeypatch.setattr(database_module, "KNOWN_VERSIONS", (*database_module.KNOWN_VERSIONS, "9999"))
    refused = _fvs(*words, "--root", str(root))
    assert refused.exit_code == _status(words)
    has = f"has version {known} of the schema, and this program needs version 9999"
    assert has in refused.stderr
    assert "fvs serve migrates it" in refused.stderr


def test_a_database_without_a_schema_stays_as_it_is(root: Path) -> None:
    file = root / "fvs.sqlite3"
    file.unlink()
    with database_module.Database(f"sqlite:///{file}").connect() as connection:
        connection.execute(text("SELECT 1"))
    before = _state(root)
    assert "has no schema" in _fvs("keys", "list", "--root", str(root)).stderr
    assert _state(root) == before
    assert "has no schema" not in _fvs("doctor", "--repair", "--root", str(root)).stderr
    assert _fvs("keys", "list", "--root", str(root)).exit_code == 0


@pytest.mark.parametrize("words", [*_LOOKING, ("keys", "create", "x")])
@pytest.mark.parametrize(
    ("error", "parts"),
    [
        (StorageUnavailableError("The database is away.", hint="Wait."), ("is away", "Wait.", "refused")),
        (IncompatibleDatabaseError("The version is newer.", hint="Upgrade."), ("newer", "Upgrade.")),
    ],
)
def test_a_storage_that_cannot_be_used_is_a_message(
    words: tuple[str, ...],
    error: Exception,
    parts: tuple[str, ...],
    root: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(_: database_module.Database) -> None:
        raise error from OSError("connection refused")

    monkeypatch.setattr(database_module.Database, "migrate", fail)
    monkeypatch.setattr(database_module.Database, "require_migrated", fail)
    failed = _fvs(*words, "--root", str(root))
    assert failed.exit_code == _status(words)
    assert isinstance(failed.exception, SystemExit), "no traceback"
    # The doctor's findings, of which an unreachable database is one with another hint, are its output.
    assert all(part in failed.output for part in parts if part != "Wait." or words != ("doctor",))


@pytest.mark.parametrize(
    "words", [*_LOOKING, ("keys", "create", "x"), ("serve", "--host", "0.0.0.0"), ("serve",)]
)
def test_a_root_that_cannot_exist_is_a_message(words: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    failed = _fvs(*words, "--root", str(tmp_path / "file" / "root"))
    assert failed.exit_code == _status(words)
    assert isinstance(failed.exception, SystemExit), "no traceback"
    assert "Error: " in failed.stderr


@pytest.mark.parametrize("words", [*_LOOKING, ("keys", "create", "x")])
def test_a_damaged_database_is_a_message(words: tuple[str, ...], root: Path) -> None:
    (root / "fvs.sqlite3").write_bytes(b"junk" * 5000)
    failed = _fvs(*words, "--root", str(root))
    assert failed.exit_code == _status(words)
    assert isinstance(failed.exception, SystemExit), "no traceback"
    assert "file is not a database" in failed.output


def test_the_doctor_examines_what_needs_no_database(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = Settings(root=root)
    settings.uploads.mkdir()
    (settings.uploads / "1.part").touch()
    monkeypatch.setenv("FVS_DATABASE_URL", "postgresql://fvs:hidden@127.0.0.1:1/fvs")
    monkeypatch.setenv("FVS_RESERVE_BYTES", "1000000000000000")
    found = _fvs("doctor", "--root", str(root), "--grace", "0")
    assert found.exit_code == 13
    assert isinstance(found.exception, SystemExit), "no traceback"
    first, *others = found.stdout.splitlines()
    assert first.startswith("The database cannot be reached: ")
    assert "FVS_DATABASE_URL" in found.stdout
    assert "hidden" not in found.output
    assert any("come to the reserve" in line for line in others)
    assert any(line.startswith("abandoned upload: ") for line in others)
    assert "was not examined" in found.stderr


def test_an_object_store_that_goes_away_during_the_examination_is_a_message(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away(_: Blobs, _before: datetime) -> tuple[Path, ...]:
        raise StorageUnavailableError("The object store cannot be reached.", hint="Try again.")

    monkeypatch.setattr(Blobs, "unfinished", away)
    failed = _fvs("doctor", "--root", str(root))
    assert failed.exit_code == 13
    assert "The object store cannot be reached.\nTry again." in failed.stderr


@pytest.mark.parametrize(
    ("scene", "tenant", "created"),
    [("scn_one", "local", True), ("scn_one", "other", False), ("scn_none", "local", False)],
)
def test_a_key_is_restricted_to_a_scene_of_its_tenant(
    scene: str, tenant: str, created: bool, root: Path
) -> None:
    with open_storage(Settings(root=root)) as storage, storage.database.writing() as session:
        repository.add_scene(session, "scn_one", "local", SceneRequest(name="one"), now())
    made = _fvs("keys", "create", "drone", "--scene", scene, "--tenant", tenant, "--root", str(root))
    listed = _fvs("keys", "list", "--root", str(root)).stdout
    if created:
        assert made.exit_code == 0
        assert scene in listed
    else:
        assert made.exit_code == 2
        assert f"Tenant {tenant} has no scene {scene}." in made.stderr
        assert listed == ""
