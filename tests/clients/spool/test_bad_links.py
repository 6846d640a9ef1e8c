"""A spool behind a bad link: everything arrives once, and little is sent twice."""

import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from fvs_client import Client
from fvs_client.spool import Outbox, State
from fvs_client.spool.outbox import FILE_NAME
from link_simulator import LinkQuality, LinkSimulator

pytestmark = pytest.mark.process

# A break or a refusal loses what is in buffers (a block of ours, what the kernel holds unsent, what the other
# side has received), and what is on its way.
_BUFFERS_BYTES = 64_000
_OVERHEAD_BYTES = 1_500
"""Of a request: its head."""
_CLIENT = """
import sys
from fvs_client.spool import Settings, Spool
settings = Settings(settle_s=0.05, look_every_s=0.02, timeout_s=2.0, first_pause_s=0.02, longest_pause_s=0.2)
Spool(sys.argv[1], sys.argv[2], url=sys.argv[3], settings=settings).run()
"""


@pytest.fixture
def folder(tmp_path: Path, photograph: Callable[..., bytes]) -> Path:
    made = tmp_path / "DCIM"
    made.mkdir()
    for number in range(6):
        (made / f"DJI_{number:04d}.JPG").write_bytes(photograph(number, size=(400, 300)))
    return made


def test_everything_arrives_once_through_breaks_failures_gaps_and_kills(
    folder: Path, url: str, client: Client
) -> None:
    scene = client.scenes.create("quarry").id
    size = sum(file.stat().st_size for file in folder.glob("*.JPG"))
    quality = LinkQuality(
        rate_bytes_s=400_000,
        latency_s=0.005,
        breaks_every_bytes=100_000,
        failing_share=0.5,
        gap_every_s=1.0,
        gap_s=0.3,
    )
    kills = 0
    with LinkSimulator(urlsplit(url).port or 0, quality, seed=1) as link:
        command = [sys.executable, "-c", _CLIENT, str(folder), scene, link.url]
        running = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        try:
            deadline = time.monotonic() + 120
            while _ended(folder) < 6:
                assert time.monotonic() < deadline
                time.sleep(0.05)
                if kills < 3 and _ended(folder) > kills:
                    running.kill()
                    running.wait()
                    kills += 1
                    running = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        finally:
            running.kill()
            running.wait()
        events, sent = link.events, link.sent_bytes["up"]
    with Outbox(folder / FILE_NAME) as outbox:
        photographs = outbox.all()
    assert {photograph.state for photograph in photographs} == {State.SENT}
    images = Counter(image.digest for image in client.scenes.images(scene).list())
    assert images == Counter(f"sha256:{photograph.digest}" for photograph in photographs)
    losses = events["breaks"] + events["refused"] + events["gaps"] + kills
    assert losses > 5
    assert sent <= size + losses * (_BUFFERS_BYTES + quality.rate_bytes_s * quality.latency_s) + (
        events["requests"] * _OVERHEAD_BYTES
    )


def test_a_good_link_carries_each_byte_once(folder: Path, url: str, client: Client) -> None:
    scene = client.scenes.create("quarry").id
    size = sum(file.stat().st_size for file in folder.glob("*.JPG"))
    with LinkSimulator(urlsplit(url).port or 0, LinkQuality(rate_bytes_s=10e6)) as link:
        command = [sys.executable, "-c", _CLIENT, str(folder), scene, link.url]
        with subprocess.Popen(command, stderr=subprocess.DEVNULL) as running:
            deadline = time.monotonic() + 60
            while _ended(folder) < 6:
                assert time.monotonic() < deadline
                time.sleep(0.05)
            running.kill()
    assert link.events["requests"] == 12  # of each one that brings it, and one that asks for the verdict
    assert link.events["connections"] == 1
    assert link.sent_bytes["up"] - size < 12 * _OVERHEAD_BYTES


def _ended(folder: Path) -> int:
    if not (folder / FILE_NAME).exists():
        return 0
    with Outbox(folder / FILE_NAME) as outbox:
        counts = outbox.counts()
    return counts[State.SENT] + counts[State.REFUSED]
