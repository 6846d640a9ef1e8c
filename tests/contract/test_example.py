"""The example of gRPC from Python, as the page shows it."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

_PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "grpc.md"


def _example(port: int) -> str:
    found = re.findall(r"^```python\n(.*?)^```$", _PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    assert len(found) == 1
    assert found[0].count("\n") <= 40
    assert found[0].count("127.0.0.1:8001") == 1
    return str(found[0].replace("127.0.0.1:8001", f"127.0.0.1:{port}"))


def test_the_example_uploads_and_ranks_and_says_why_it_is_refused(
    tenant: Any,
    gateway: Any,
    rpc_port: int,
    photograph: Callable[..., bytes],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    scene = tenant.scene(name="quarry")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "photographs").mkdir()
    (tmp_path / "photographs" / "a.jpg").write_bytes(photograph(3))
    program = compile(_example(rpc_port), "example.py", "exec")

    monkeypatch.setenv("FVS_API_KEY", tenant.key)
    exec(program, {})
    said = capsys.readouterr().out
    assert "VERDICT_ACCEPTED" in said
    assert "no-snapshot" in said

    gateway.model(scene, tenant.headers)
    exec(program, {})
    assert re.search(r"^next: \S+$", capsys.readouterr().out, re.MULTILINE)

    monkeypatch.setenv("FVS_API_KEY", "fvs_0000_wrong")
    exec(program, {})
    assert " unauthenticated " in capsys.readouterr().out
