"""What clients read of the engine's errors names no folder of the server."""

import sys
from pathlib import Path

import pytest
from fvs_service.engine_errors import from_engine, without_folders

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.storage import storage_error


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("There is no room left to write {root}/scenes/scn_1/a.json.", "…to write scenes/scn_1/a.json."),
        ("[Errno 2] No such file: '{root}/my data/a.bin'", "[Errno 2] No such file: 'my data/a.bin'"),
        ("The disk of {root} is full.", "The disk of data is full."),
        ('File "{python}/lib/x.py", line 3', 'File "lib/x.py", line 3'),
        (
            "See GET /v1/capabilities, or https://example.org/a/b/c: 3/4 px/s.",
            "…or https://example.org/a/b/c: 3/4 px/s.",
        ),
    ],
)
@pytest.mark.parametrize("linked", [False, True])
def test_texts_name_files_below_the_root(tmp_path: Path, said: str, shown: str, *, linked: bool) -> None:
    root = tmp_path / "data"
    root.mkdir()
    if linked:
        (tmp_path / "link").mkdir()
        (tmp_path / "link" / "data").symlink_to(root)
    found = without_folders(
        said.format(root=root, python=sys.prefix), tmp_path / "link" / "data" if linked else root
    )
    assert found.endswith(shown.removeprefix("…"))
    assert str(tmp_path) not in found


def test_a_folder_within_another_one_goes_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "venv"))  # in that for temporary files
    assert without_folders(f"{tmp_path}/venv/lib/x.py", tmp_path / "data") == "lib/x.py"


def test_errors_of_the_engine_lose_the_folders_of_the_server() -> None:
    root = Path("/srv/fvs")
    full = from_engine(storage_error(OSError(28, "No space left on device"), "/srv/fvs/scenes/a"), root)
    assert (full.code, full.status) == ("out-of-space", 507)
    assert "/" not in full.message + full.hint
    wrong = from_engine(
        InvalidInputError("/srv/fvs/a.txt is not JSON.", hint="Look at /srv/fvs/a.txt."), root
    )
    assert (wrong.message, wrong.hint) == ("a.txt is not JSON.", "Look at a.txt.")
    unwritable = storage_error(OSError(13, "Permission denied"), root / "scenes" / "scn_1" / "a.bin")
    assert unwritable.path == root / "scenes" / "scn_1" / "a.bin"
    for place in (root, Path("/elsewhere")):
        error = from_engine(unwritable, place)
        assert error.message == "a.bin cannot be written: Permission denied."
