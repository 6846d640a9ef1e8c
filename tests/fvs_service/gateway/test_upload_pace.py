"""Patience with uploads, on a clock that the test sets."""

import asyncio
from pathlib import Path
from types import SimpleNamespace

import pytest
from fvs_service.errors import SlowRequestError
from fvs_service.gateway import upload_pace
from fvs_service.gateway.upload_pace import UploadPace
from fvs_service.settings import Settings


def _receive(parts: list[tuple[float, bytes]], monkeypatch: pytest.MonkeyPatch, folder: Path) -> UploadPace:
    """Receive parts, each after so many seconds, at 100 bytes per second or more after a grace of 1 s."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(upload_pace, "time", SimpleNamespace(monotonic=lambda: clock.now))
    pace = UploadPace(Settings(root=folder, upload_idle_s=60.0, upload_grace_s=1.0, upload_bytes_per_s=100.0))

    async def receive_all() -> None:
        for after_s, part in parts:

            async def receive(after_s: float = after_s, part: bytes = part) -> bytes:
                clock.now += after_s
                return part

            await pace.wait(receive, len)

    asyncio.run(receive_all())
    return pace


def test_a_slow_but_steady_body_arrives(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert _receive([(0.5, b"a" * 60)] * 100, monkeypatch, tmp_path).received_bytes == 6_000


@pytest.mark.parametrize("start", [b"", b"a" * 500_000], ids=["slow start", "fast start"])
def test_a_body_that_is_too_slow_does_not(
    start: bytes, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with pytest.raises(SlowRequestError, match="less than 100 bytes per second"):
        _receive([(0.0, start)] + [(0.5, b"a" * 40)] * 20, monkeypatch, tmp_path)
