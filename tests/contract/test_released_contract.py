"""The check of the protos against the released contract, in a copy of both."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

_ROOT = Path(__file__).resolve().parents[2]
_FIELD = "double progress = 7;"


class Copy:
    """The protos and what is generated from them, with the program that checks them."""

    def __init__(self, folder: Path) -> None:
        for name in ("proto", "services/fvs"):
            shutil.copytree(_ROOT / name, folder / name)
        self.folder = folder
        self.released = folder / "proto/released.binpb"

    def run(self, *options: str) -> tuple[int, str]:
        """The exit status and the output."""
        command = [sys.executable, str(self.folder / "proto/generate.py"), *options]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        return done.returncode, done.stdout + done.stderr

    def change(self, before: str, after: str) -> None:
        """Change the jobs' proto, and generate what follows from it."""
        path = self.folder / "proto/fvs/v1/jobs.proto"
        text = path.read_text()
        assert text.count(before) == 1
        path.write_text(text.replace(before, after))
        assert self.run() == (0, "")


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    return Copy(tmp_path)


@pytest.mark.system
def test_a_renumbered_field_is_found_until_it_is_released(copy: Copy) -> None:
    assert copy.run("--check") == (0, "")
    copy.change(_FIELD, _FIELD.replace("7", "99"))
    status, said = copy.run("--check")
    assert status == 1
    assert 'Previously present field "7" with name "progress" on message "Job" was deleted' in said
    assert copy.run("--release") == (0, "")
    assert copy.run("--check") == (0, "")


@pytest.mark.system
def test_a_new_field_breaks_nobody(copy: Copy) -> None:
    copy.change(_FIELD, f"{_FIELD}\n  optional double speed = 99;")
    assert copy.run("--check") == (0, "")


def test_without_a_released_contract_the_check_fails(copy: Copy) -> None:
    copy.released.unlink()
    status, said = copy.run("--check")
    assert status == 1
    assert "released.binpb" in said
