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
_HEAD_BYTES = 500
"""Of a request, in the mean."""
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


@pytest.mark.system
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


@pytest.mark.system
def test_a_break_loses_what_is_in_buffers_and_not_what_has_arrived(
    tmp_path: Path, url: str, client: Client, photograph: Callable[..., bytes]
) -> None:
    """About 20 kB per break; half a piece if the service kept nothing of a broken request."""
    folder = tmp_path / "DCIM"
    folder.mkdir()
    for number in range(8):
        (folder / f"DJI_{number:04d}.JPG").write_bytes(photograph(number, size=(800, 600)))
    scene = client.scenes.create("quarry").id
    size = sum(file.stat().st_size for file in folder.glob("*.JPG"))
    quality = LinkQuality(rate_bytes_s=2e6, latency_s=0.002, breaks_every_bytes=120_000)
    with LinkSimulator(urlsplit(url).port or 0, quality, seed=5) as link:
        client_of_large_pieces = (
            f"from fvs_client.spool import pieces\npieces._SMALLEST_BYTES = 1 << 18\n{_CLIENT}"
        )
        command = [sys.executable, "-c", client_of_large_pieces, str(folder), scene, link.url]
        with subprocess.Popen(command, stderr=subprocess.DEVNULL) as running:
            deadline = time.monotonic() + 60
            while _ended(folder) < 8:
                assert time.monotonic() < deadline
                time.sleep(0.05)
            running.kill()
        events, sent = link.events, link.sent_bytes["up"]
    assert len(list(client.scenes.images(scene).list())) == 8
    lost = (sent - size - events["requests"] * _HEAD_BYTES) / events["breaks"]
    print(f"{events['breaks']} breaks, {lost:.0f} bytes each")  # noqa: T201
    assert events["breaks"] > 10
    assert lost < 35_000


@pytest.mark.system
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
