import errno
import fcntl
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fvs_engine.errors import InvalidInputError, OutputExistsError, StorageError
from fvs_engine.files.atomic import write_bytes_atomically
from fvs_engine.files.storage import (
    DiskFullError,
    blame_full_disk,
    require_free_bytes,
    storage_errors,
)
from fvs_engine.pipeline.manifest import ImagesRecord, Manifest, Metrics, ReconstructionSettings
from fvs_engine.pipeline.workspace import Workspace


@pytest.fixture
def manifest() -> Manifest:
    images = ImagesRecord(folder="/photographs", photographs=(), rejected=())
    return Manifest(settings=ReconstructionSettings(iterations=7), images=images)


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return Workspace(tmp_path / "out")


def test_a_manifest_survives_the_disk(workspace: Workspace, manifest: Manifest) -> None:
    with workspace.locked():
        assert workspace.read_manifest() is None
        workspace.write_manifest(manifest)
        assert workspace.read_manifest() == manifest
    assert sorted(path.name for path in workspace.root.iterdir()) == [".lock", "manifest.json"]


@pytest.mark.parametrize(
    "content", ["", "{", "[]", '{"version": 2}', '{"version": 1, "surprise": 0}', "\0\0\0"]
)
def test_a_damaged_manifest_is_named_with_a_remedy(workspace: Workspace, content: str) -> None:
    workspace.root.mkdir()
    workspace.manifest_path.write_text(content)
    with pytest.raises(StorageError, match=r"manifest\.json cannot be used") as caught:
        workspace.read_manifest()
    assert "--overwrite" in caught.value.hint


def test_non_finite_metrics_are_never_written() -> None:
    with pytest.raises(ValueError, match="finite"):
        Metrics(
            views=(),
            psnr_db=float("nan"),
            ssim=None,
            iterations=1,
            gaussians=1,
            training_seconds=1.0,
            peak_memory_bytes=1,
        )


def test_a_folder_of_somebody_else_is_left_alone(workspace: Workspace) -> None:
    workspace.root.mkdir()
    (workspace.root / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputExistsError, match=r"thesis\.tex"), workspace.locked():
        pytest.fail("the folder was taken")
    assert [path.name for path in workspace.root.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("name", ["images", "renders"])
def test_without_a_manifest_a_familiar_name_is_somebody_elses_too(workspace: Workspace, name: str) -> None:
    (workspace.root / name).mkdir(parents=True)
    (workspace.root / name / "IMG_0001.jpg").write_text("the only copy")
    with pytest.raises(OutputExistsError, match=name), workspace.locked():
        workspace.clear()
    assert (workspace.root / name / "IMG_0001.jpg").read_text() == "the only copy"


def test_what_a_kill_before_the_manifest_leaves_is_no_strangers(workspace: Workspace) -> None:
    workspace.root.mkdir()
    (workspace.root / ".lock").touch()
    (workspace.root / ".manifest.json.4711.partial").write_text("{")
    with workspace.locked():
        assert workspace.read_manifest() is None


def test_clear_deletes_what_fvs_wrote_and_nothing_else(workspace: Workspace, manifest: Manifest) -> None:
    with workspace.locked():
        workspace.write_manifest(manifest)
        workspace.images.mkdir()
        (workspace.images / "a.jpg").touch()
        (workspace.root / "notes.txt").write_text("mine")
        workspace.clear()
        assert sorted(path.name for path in workspace.root.iterdir()) == [".lock", "notes.txt"]


def test_two_processes_do_not_write_to_one_folder(workspace: Workspace) -> None:
    script = (
        "import sys; from pathlib import Path; from fvs_engine.pipeline.workspace import Workspace\n"
        "with Workspace(Path(sys.argv[1])).locked(): pass"
    )
    command = [sys.executable, "-c", script, str(workspace.root)]
    with workspace.locked():
        locked_out = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "OutputExistsError: Another process is writing" in locked_out.stderr
    assert subprocess.run(command, check=False).returncode == 0


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_is_not_another_process(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def flock(_file: object, _operation: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", flock)
    with pytest.raises(StorageError, match="cannot lock files") as caught, workspace.locked():
        pytest.fail("the folder was taken without a lock")
    assert not isinstance(caught.value, OutputExistsError)
    assert "local disk" in caught.value.hint


def test_a_file_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for root in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(StorageError, match="a file is in the way"), Workspace(root).locked():
            pytest.fail("a file was taken for a folder")


def test_a_folder_without_a_manifest_is_no_output(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="fvs reconstruct"):
        Workspace.existing(tmp_path)


def test_a_full_disk_has_its_own_error_and_keeps_the_old_file(tmp_path: Path) -> None:
    script = (
        "import resource, sys; from pathlib import Path\n"
        "from fvs_engine.files.storage import DiskFullError\n"
        "from fvs_engine.files.atomic import write_bytes_atomically\n"
        "path = Path(sys.argv[1]); write_bytes_atomically(path, b'old')\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try: write_bytes_atomically(path, bytes(2000))\n"
        "except DiskFullError as error: print(error)\n"
    )
    target = tmp_path / "file.bin"
    run = subprocess.run(
        [sys.executable, "-c", script, str(target)], capture_output=True, text=True, check=True
    )
    assert "no room left to write" in run.stdout
    assert "same command again" in run.stdout
    assert target.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["file.bin"]


def test_dev_full_is_a_full_disk() -> None:
    with (
        pytest.raises(DiskFullError),
        storage_errors(Path("/dev/full")),
        Path("/dev/full").open("wb", 0) as file,
    ):
        file.write(b"x")


def test_a_native_failure_on_a_full_disk_is_blamed_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> None:
        with blame_full_disk(tmp_path):
            raise RuntimeError("SQLite error: disk I/O error")

    with pytest.raises(RuntimeError, match="SQLite"):
        fail()
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: usage._replace(free=0))
    with pytest.raises(DiskFullError, match="is full") as caught:
        fail()
    assert "same command again" in caught.value.hint


def test_room_is_asked_for_before_it_is_needed(tmp_path: Path) -> None:
    require_free_bytes(tmp_path / "not" / "there" / "yet", 1)
    with pytest.raises(DiskFullError, match="MB"):
        require_free_bytes(tmp_path / "not" / "there" / "yet", 1 << 60)


def test_an_atomic_write_leaves_no_trace_of_a_failure(tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    with pytest.raises(StorageError):
        write_bytes_atomically(tmp_path / "taken", b"x")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_the_manifest_is_plain_json(workspace: Workspace, manifest: Manifest) -> None:
    with workspace.locked():
        workspace.write_manifest(manifest)
    document = json.loads(workspace.manifest_path.read_text())
    assert document["version"] == 1
    assert document["settings"]["iterations"] == 7
