import pytest
from fvs_service.disclosure import without_paths
from fvs_service.engine_errors import from_engine

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.storage import storage_error


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("There is no room left to write /srv/fvs/scenes/scn_1/choice.json.", "…write choice.json."),
        ("[Errno 2] No such file or directory: '/srv/my data/fvs/a.bin'", "…directory: 'a.bin'"),
        ("/srv/my data/fvs/scenes/scn_1/a.bin is incomplete.", "my a.bin is incomplete."),
        ("(sqlite3.OperationalError) in /root/fvs.sqlite3", "…in fvs.sqlite3"),
        ('File "/usr/lib/python3/site-packages/x.py", line 3', '…"x.py", line 3'),
        ("The disk of /data is full.", "The disk of data is full."),
        ("See GET /v1/capabilities, or https://example.org/a/b/c.", None),
        ("images 3/4 and/or 5 px/s, a ratio of 1/2", None),
        ("Frame 3 of images/a.jpg has no camera.", None),
    ],
)
def test_messages_name_files_and_no_folders(message: str, shown: str | None) -> None:
    found = without_paths(message)
    assert found == message if shown is None else found.endswith(shown.removeprefix("…"))
    assert "/srv" not in found
    assert "scn_1" not in found


def test_errors_of_the_engine_lose_their_paths() -> None:
    full = from_engine(storage_error(OSError(28, "No space left on device"), "/srv/fvs/scenes/a"))
    assert (full.code, full.status) == ("out-of-space", 507)
    assert "/" not in full.message + full.hint
    wrong = from_engine(InvalidInputError("/srv/fvs/a.txt is not JSON.", hint="Look at /srv/fvs/a.txt."))
    assert (wrong.message, wrong.hint) == ("a.txt is not JSON.", "Look at a.txt.")
