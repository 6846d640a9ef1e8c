"""Throughput of uploads, and memory of the gateway during them.

    python benchmarks/service_uploads.py [--images 1000] [--megabytes 4] [--clients 8] [--json uploads.json]

Makes the given number of JPEGs of 12 megapixels (noise, compressed until it has the size; each has other
pixels, because a number of its quantisation table differs) and sends them into one scene of `fvs serve` with
its defaults, from the given number of client processes, one connection each. Then the same clients send the
same images again.

Beside it, of some of the images: what writing them to the same disk takes, each flushed, and what decoding
them takes on one core, without which there is no verdict. Memory is the gateway's
own (resident, seen twice a second), and that of the children that look at images. Needs twice the images'
size on the disk of the temporary folder.
"""

import argparse
import io
import multiprocessing
import os
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from fvs_client import Client
from fvs_service.serving.running import GATEWAY, RunningService, running_service
from measurement import report
from PIL import Image

from fvs_engine.images.pixels import decode

_SIZE = (4000, 3000)
_ZIGZAG = range(1, 64)
"""Places of a quantisation table, without that of the mean."""
_CHILD = "--multiprocessing-fork"
_SAMPLE = 20
"""Images for what is measured beside."""


def jpeg_of(size_bytes: int) -> bytes:
    """A JPEG of noise that is at least so large, by the lowest quality that makes it so."""
    noise = np.random.default_rng(0).normal(0, 10, (_SIZE[1], _SIZE[0]))
    slope = np.linspace(40, 215, _SIZE[0])
    grey = np.clip(noise + slope, 0, 255).astype(np.uint8)
    image = Image.merge("RGB", [Image.fromarray(grey)] * 3)
    for quality in range(10, 100):
        content = io.BytesIO()
        image.save(content, "JPEG", quality=quality)
        if content.tell() >= size_bytes:
            return content.getvalue()
    raise SystemExit(f"No JPEG of {_SIZE[0]}×{_SIZE[1]} px has {size_bytes} bytes.")


def variants(jpeg: bytes) -> Iterator[bytes]:
    """JPEGs with other pixels: each multiplies one frequency of all blocks by another number."""
    table = jpeg.index(b"\xff\xdb") + 5  # marker, length, and which table it is
    for step in range(1, 64):
        for place in _ZIGZAG:
            value = (jpeg[table + place] + step) % 255 + 1
            yield jpeg[: table + place] + bytes([value]) + jpeg[table + place + 1 :]


def write_images(folder: Path, count: int, size_bytes: int) -> list[Path]:
    folder.mkdir()
    files = []
    for number, content in zip(range(count), variants(jpeg_of(size_bytes)), strict=False):
        files.append(folder / f"{number:06d}.jpg")
        files[-1].write_bytes(content)
    return files


def send(url: str, scene_id: str, files: Sequence[Path], begin: Any, told: Any) -> None:
    """Upload everything twice as one client, and report both outcomes."""
    with Client(url) as client:
        scene = client.scenes.get(scene_id)
        for _ in range(2):
            begin.wait()
            sent = scene.images.upload(files, parallel=1)
            told.put(
                (sent.bytes_sent, len(sent.sent), len(sent.already_there), len(sent.failed + sent.rejected))
            )
            begin.wait()


@dataclass
class Memory:
    """Samples the resident memory of the gateway and of its children, in MB."""

    service: RunningService
    gateway: list[float] = field(default_factory=list)
    children: list[float] = field(default_factory=list)

    def watch(self, stop: threading.Event) -> None:
        (gateway,) = self.service.processes(GATEWAY)
        while not stop.wait(0.5):
            self.gateway.append(resident_mb(gateway))
            self.children.append(sum(map(resident_mb, self.service.processes(_CHILD))))


def resident_mb(pid: int) -> float:
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except OSError:
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def disk_mb_per_s(files: Sequence[Path], folder: Path) -> float:
    """Speed of writing images one after the other, each flushed to disk."""
    contents = [file.read_bytes() for file in files[:_SAMPLE]]
    began = time.perf_counter()
    for number, content in enumerate(contents):
        with (folder / f"{number}.tmp").open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    return sum(map(len, contents)) / 1e6 / (time.perf_counter() - began)


def decoding_ms(files: Sequence[Path]) -> float:
    """Processor time of decoding one image."""
    contents = [file.read_bytes() for file in files[:_SAMPLE]]
    began = time.process_time()
    for content in contents:
        decode(content)
    return 1e3 * (time.process_time() - began) / len(contents)


def measure(folder: Path, files: Sequence[Path], clients: int) -> Iterator[dict[str, Any]]:
    """A row for the first time, and one for the second."""
    context = multiprocessing.get_context("spawn")
    begin, told = context.Barrier(clients + 1), context.Queue()
    megabytes = sum(file.stat().st_size for file in files) / 1e6
    with (
        running_service(folder / "service", folder / "service.log") as service,
        Client(service.url) as client,
    ):
        scene = client.scenes.create("benchmark")
        senders = [
            context.Process(target=send, args=(service.url, scene.id, files[first::clients], begin, told))
            for first in range(clients)
        ]
        for sender in senders:
            sender.start()
        for time_ in ("first", "again"):
            begin.wait()
            memory, stop = Memory(service), threading.Event()
            watcher = threading.Thread(target=memory.watch, args=(stop,))
            watcher.start()
            began = time.perf_counter()
            sent, new, known, refused = map(sum, zip(*(told.get() for _ in senders), strict=True))
            took = time.perf_counter() - began
            stop.set()
            watcher.join()
            begin.wait()
            tenth = max(1, len(memory.gateway) // 10)
            yield {
                "": time_,
                "s": took,
                "images/s": len(files) / took,
                "MB/s": megabytes / took,
                "new": new,
                "known": known,
                "refused": refused,
                "image MB sent": sent / 1e6,
                "gateway MB, a tenth in": float(
                    np.median(memory.gateway[tenth : 2 * tenth] or memory.gateway[-1:])
                ),
                "at the end": memory.gateway[-1],
                "at most": max(memory.gateway),
                "children, at most": max(memory.children),
            }
        for sender in senders:
            sender.join()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--images", type=int, default=1000)
    parser.add_argument("--megabytes", type=float, default=4.0, help="of each image")
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
        folder = Path(name)
        files = write_images(folder / "images", options.images, round(options.megabytes * 1e6))
        beside = {
            "disk alone, MB/s": disk_mb_per_s(files, folder),
            "decoding, ms of a core": decoding_ms(files),
        }
        rows = [{**row, **beside} for row in measure(folder, files, options.clients)]
    report(
        f"{options.images} images of {options.megabytes:g} MB from {options.clients} clients",
        rows,
        options.json,
    )


if __name__ == "__main__":
    main()
