"""Folders that only one user can use."""

import os
import stat
from pathlib import Path

import pytest

from fvs_engine.errors import StorageError
from fvs_engine.files import private_folder as module
from fvs_engine.files.private_folder import private_folder


@pytest.fixture(autouse=True)
def temporary(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The temporary folder of these tests."""
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr(module.tempfile, "gettempdir", lambda: str(tmp_path))
    return tmp_path


def _mode(folder: Path) -> int:
    return stat.S_IMODE(folder.stat().st_mode)


def test_it_is_the_same_folder_every_time_and_closed_to_others(temporary: Path) -> None:
    folder = private_folder("locks")
    assert folder == temporary / f"locks-{os.geteuid()}" == private_folder("locks")
    assert _mode(folder) == 0o700


def test_it_is_in_the_runtime_folder_if_there_is_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert private_folder("locks") == tmp_path / "locks"


def test_an_open_folder_of_this_user_is_closed(temporary: Path) -> None:
    folder = temporary / f"locks-{os.geteuid()}"
    folder.mkdir()
    folder.chmod(0o777)
    private_folder("locks")
    assert _mode(folder) == 0o700


def test_a_folder_of_another_user_is_refused(monkeypatch: pytest.MonkeyPatch, temporary: Path) -> None:
    another = os.geteuid() + 1
    monkeypatch.setattr(module.os, "geteuid", lambda: another)
    (temporary / f"locks-{another}").mkdir()
    with pytest.raises(StorageError, match="not a folder of this user") as refused:
        private_folder("locks")
    assert "XDG_RUNTIME_DIR" in refused.value.hint


@pytest.mark.parametrize("what", ["link", "file"])
def test_what_is_no_folder_is_refused(temporary: Path, what: str) -> None:
    path = temporary / f"locks-{os.geteuid()}"
    if what == "link":
        (temporary / "elsewhere").mkdir(mode=0o700)
        path.symlink_to("elsewhere")
    else:
        path.touch()
    with pytest.raises(StorageError, match="not a folder of this user"):
        private_folder("locks")
