import json
from pathlib import Path

import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.json_input import read_json, read_text


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32"])
def test_text_is_read_in_the_encodings_of_windows(encoding: str, tmp_path: Path) -> None:
    file = tmp_path / "zone.json"
    mark = "\ufeff" if encoding == "utf-16-le" else ""
    file.write_bytes((mark + json.dumps({"name": "Gebäude"}, ensure_ascii=False)).encode(encoding))
    assert read_json(file) == {"name": "Gebäude"}
    assert read_text(file).startswith("{")


@pytest.mark.parametrize(
    ("content", "message"), [(b"{", "is not JSON"), (b"\xe4", "is not a text file"), (None, "cannot be read")]
)
def test_what_is_no_text_is_named(content: bytes | None, message: str, tmp_path: Path) -> None:
    file = tmp_path / "zone.json"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InvalidInputError, match=rf"zone\.json {message}"):
        read_json(file)
