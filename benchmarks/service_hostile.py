"""Lag of the gateway's event loop, and an honest client's uploads, while hostile requests arrive.

    python benchmarks/service_hostile.py [--seconds 300] [--rate 100] [--connections 20] [--no-budget]
                                         [--proxy] [--json hostile.json]

Starts `fvs serve`, with keys, with a small model of a simulated courtyard. First only the honest client is
there, for a fifth of the time: in each round it uploads an image, as the Python client does, and ranks eight
candidates. Then, for all of the time, the given number of connections send hostile requests of every kind
beside it, at the given rate, in turn with a key that may only upload and with keys that do not exist. With
`--no-budget` the same is done once more with a service that puts no key on hold. With `--proxy` all come
through Caddy with the configuration of `deploy/proxy`, each hostile request by a TLS connection of its own.
The lag is the gateway's own `fvs_loop_lag_seconds`, of which the bucket is known: a lag is at most the number
shown.
"""

import argparse
import contextlib
import hashlib
import io
import itertools
import multiprocessing
import os
import secrets
import select
import socket
import ssl
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event
from pathlib import Path
from statistics import median
from typing import Any
from urllib.parse import urlsplit

import httpx2
import numpy as np
from fvs_client import Client
from fvs_service.application import open_storage
from fvs_service.principal import Scope
from fvs_service.serving.running import GATEWAY, RunningService, running_service
from fvs_service.settings import Settings
from measurement import report
from PIL import Image

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "servers"))
from proxy_server import Proxy, running_proxy

_BYTES = 1_400_000
_NO_BUDGET = 1_000_000_000
_ATTACK_NICENESS = 19
_ANY_SERVICE = ssl._create_unverified_context()
_PATIENCE_S = 0.5
"""Time after which a hostile client hangs up: some requests are incomplete, and never answered."""


def post(path: str, body: bytes, kind: str = "application/json", *headers: str) -> bytes:
    more = "".join(f"{header}\r\n" for header in headers)
    head = (
        f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
    )
    return f"{head}{more}\r\n".encode() + body


def requests_of(scene: str) -> dict[str, bytes]:
    """One request of each kind."""
    check, rank = f"/v1/scenes/{scene}/images:check", f"/v1/scenes/{scene}/rankings"
    form, sent = f"/v1/scenes/{scene}/images", "multipart/form-data; boundary=b"
    chunked = f"POST {check} HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n"
    many = ",".join(f'"k{number}":1' for number in range(23_000))
    query = "&".join(f"k{number}" for number in range(2_000))
    return {
        "wrong digests": post(check, b'{"digests":[' + b"1," * (_BYTES // 2) + b"1]}"),
        "10,000 wrong digests": post(check, b'{"digests":[' + b"1," * 9_999 + b"1]}"),
        "empty candidates": post(rank, b'{"candidates":[' + b"{}," * (_BYTES // 3) + b"{}]}"),
        "2,000 empty candidates": post(rank, b'{"candidates":[' + b"{}," * 1_999 + b"{}]}"),
        "no such scene": post("/v1/scenes/scn_none/rankings", b"[" * _BYTES),
        "deep lists": post(rank, b"[" * _BYTES),
        "long numbers": post(check, b'{"digests":[' + (b"9" * 4_000 + b",") * (_BYTES // 4_001) + b"1]}"),
        "escapes": post(check, b'{"digests":["' + b"\\n" * (_BYTES // 2 - 10) + b'"]}'),
        "many keys": post(rank, f"{{{many}}}".encode()),
        "spaces": post(rank, b" " * _BYTES),
        "large scene": post("/v1/scenes", b'{"name":"' + b"n" * _BYTES + b'"}'),
        "form of headers": post(form, b"--b\r\n" + b"a: b\r\n" * 50_000, sent),
        "form of boundaries": post(form, b"\r\n--" * 100_000, sent),
        "chunks of a byte": f"{chunked}\r\n".encode() + b"1\r\na\r\n" * 50_000,
        "headers": b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 10_000,
        "pipelined": b"GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\n" * 1_000,
        "query": f"GET /v1/scenes?{query} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode(),
        "foreign page": post(f"/v1/scenes/{scene}/jobs", b"{}", "text/plain", "Origin: https://evil.example"),
        "hang-up": post("/v1/scenes", b"{" * 100_000)[:1_000],
        "gzip": post("/v1/scenes", b"\x1f\x8b" * 1_000, "application/json", "Content-Encoding: gzip"),
    }


def with_key(request: bytes, key: str) -> bytes:
    head, _, rest = request.partition(b"\r\n")
    return head + f"\r\nAuthorization: Bearer {key}\r\n".encode() + rest


def wrong_key() -> str:
    return f"fvs_{secrets.token_hex(8)}_{secrets.token_urlsafe(32)}"


def send_until_answered(connection: socket.socket, content: bytes) -> None:
    """Send, and hang up at the first bytes of a response, or when patience ends."""
    connection.setblocking(False)
    left, until = memoryview(content), time.monotonic() + _PATIENCE_S
    while (patience_s := until - time.monotonic()) > 0:
        readable, writable, _ = select.select([connection], [connection] if left else [], [], patience_s)
        with contextlib.suppress(ssl.SSLWantReadError, ssl.SSLWantWriteError):
            if writable:
                left = left[connection.send(left) :]
            if readable:
                connection.recv(4_096)
                return


@dataclass
class Attack:
    """Connections that send hostile requests at a fixed rate."""

    address: tuple[str, int]
    requests: Sequence[bytes]
    rate: float
    connections: int
    secure: bool

    def run(self, stop: Event, sent: "Synchronized[int]") -> None:
        """Send until stopped, counting; a connection whose request took longer than its turn makes up for it.

        At the lowest priority: in life these clients are on other machines, and take no processor of ours.
        """
        os.nice(_ATTACK_NICENESS)
        turns, lock = itertools.cycle(self.requests), threading.Lock()
        now = time.monotonic()
        starts = [now + number / self.rate for number in range(self.connections)]
        threads = [
            threading.Thread(target=self._one, args=(turns, lock, start, stop, sent)) for start in starts
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def _one(
        self, turns: Any, lock: threading.Lock, due: float, stop: Event, sent: "Synchronized[int]"
    ) -> None:
        while not stop.wait(max(0.0, due - time.monotonic())):
            due += self.connections / self.rate
            with lock:
                content = next(turns)
                sent.value += 1
            with contextlib.suppress(OSError), self._connected() as connection:
                send_until_answered(connection, content)

    def _connected(self) -> socket.socket:
        connection = socket.create_connection(self.address, 5)
        if not self.secure:
            return connection
        with connection:  # closed if the handshake fails; else the secured socket has it
            return _ANY_SERVICE.wrap_socket(connection, server_hostname="localhost")


@contextlib.contextmanager
def under(attack: Attack) -> Iterator["Synchronized[int]"]:
    """Attack from a process of its own for as long as the block lasts; yields how many requests were sent."""
    spawned = multiprocessing.get_context("spawn")
    stop, sent = spawned.Event(), spawned.Value("q", 0)
    process = spawned.Process(target=attack.run, args=(stop, sent))
    process.start()
    try:
        yield sent
    finally:
        stop.set()
        process.join()


def photograph(number: int) -> bytes:
    pixels = np.random.default_rng(number).integers(0, 256, (600, 800, 3), dtype=np.uint8)
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "JPEG")
    return out.getvalue()


@dataclass(frozen=True)
class Round:
    """Seconds that the honest client waited."""

    upload: float
    ranking: float


def honest(client: httpx2.Client, scene: str, until: float, numbers: "itertools.count[int]") -> list[Round]:
    """In each round an upload, and then a ranking."""
    ranking = {"generator": {"kind": "orbit", "count": 8}}
    rounds = []
    while time.monotonic() < until:
        content = photograph(next(numbers))
        digest = f"sha256:{hashlib.sha256(content).hexdigest()}"
        began = time.perf_counter()
        client.post(f"/v1/scenes/{scene}/images:check", json={"digests": [digest]}).raise_for_status()
        client.put(f"/v1/scenes/{scene}/images/{digest}", content=content).raise_for_status()
        uploaded = time.perf_counter()
        client.post(f"/v1/scenes/{scene}/rankings", json=ranking).raise_for_status()
        rounds.append(Round(uploaded - began, time.perf_counter() - uploaded))
    return rounds


def scene_with_model(client: Client, folder: Path) -> str:
    """The id of a scene of which the service has trained a model."""
    camera = SimulatedCamera.like_a_drone(320, 240)
    write_photographs(folder, courtyard(), camera, orbit(6, turns=0.24), Monitor())
    scene = client.scenes.create("honest")
    scene.images.upload(folder / "images")
    scene.update(iterations=200, long_side_px=160).wait()
    return scene.id


def lags(client: httpx2.Client) -> dict[float, float]:
    """Observations by the upper bound of their bucket, cumulated."""
    start = 'fvs_loop_lag_seconds_bucket{le="'
    lines = [line for line in client.get("/metrics").text.splitlines() if line.startswith(start)]
    pairs = [line.removeprefix(start).split('"} ') for line in lines]
    return {float(bound): float(count) for bound, count in pairs}


def share(before: dict[float, float], after: dict[float, float], least: float) -> float:
    """The bound under which this share of the observations between the two lies, in ms."""
    total = after[float("inf")] - before[float("inf")]
    return 1e3 * next(bound for bound in after if after[bound] - before[bound] >= least * total)


@dataclass
class Benchmark:
    """A service with a model, and the honest client of it."""

    service: RunningService
    client: httpx2.Client
    url: str
    scene: str
    upload_key: str
    numbers: "itertools.count[int]"

    @classmethod
    @contextlib.contextmanager
    def running(cls, root: Path, budget: int | None, proxied: bool) -> "Iterator[Benchmark]":
        """Run a service in ``root``; ``budget`` is its limit of refusals per key, None for the default."""
        environment = {"FVS_REQUIRE_KEYS": "true"}
        if budget is not None:
            environment["FVS_LIMITS__REFUSALS_PER_KEY"] = str(budget)
        with open_storage(Settings(root=root / "root")) as storage:
            honest_key = storage.keys.create("honest")
            upload_key = storage.keys.create("hostile", scopes=frozenset({Scope.UPLOAD}))
        with contextlib.ExitStack() as stack:
            service = stack.enter_context(running_service(root / "root", root / "log", environment))
            proxy: Proxy | None = None
            if proxied:
                proxy = stack.enter_context(running_proxy(root / "proxy", service.url))
            url = service.url if proxy is None else proxy.url
            trusted = None if proxy is None else ssl.create_default_context(cafile=str(proxy.authority))
            with Client(url, api_key=honest_key, ssl_context=trusted) as honest_client:
                scene = scene_with_model(honest_client, root / "courtyard")
            client = httpx2.Client(
                base_url=url,
                timeout=120,
                headers={"Authorization": f"Bearer {honest_key}"},
                verify=trusted or True,
            )
            yield cls(service, stack.enter_context(client), url, scene, upload_key, itertools.count())

    def alone(self, seconds: float) -> dict[str, Any]:
        """The row of the honest client alone."""
        return self._phase(seconds)

    def attacked(self, seconds: float, rate: float, connections: int) -> dict[str, Any]:
        """The row of the honest client beside hostile ones."""
        parts = urlsplit(self.url)
        sent_by_all = [
            with_key(request, key)
            for request in requests_of(self.scene).values()
            for key in (self.upload_key, wrong_key())
        ]
        secure = parts.scheme == "https"
        attack = Attack((parts.hostname or "", parts.port or 0), sent_by_all, rate, connections, secure)
        with under(attack) as sent:
            while not sent.value:
                time.sleep(0.1)
            first = sent.value
            row = self._phase(seconds)
            count = sent.value - first
            busy_ms = 10 * row["loop busy, %"] * row["seconds"]
            return {
                **row,
                "hostile requests/s": round(count / row["seconds"], 1),
                "loop ms/request": busy_ms / count,
            }

    def _phase(self, seconds: float) -> dict[str, Any]:
        before, busy_s, began = lags(self.client), self._busy_s(), time.monotonic()
        rounds = honest(self.client, self.scene, began + seconds, self.numbers)
        after, took_s = lags(self.client), time.monotonic() - began
        total = after[float("inf")] - before[float("inf")]
        return {
            "seconds": took_s,
            "lag p50 ms ≤": share(before, after, 0.5),
            "lag p99 ms ≤": share(before, after, 0.99),
            "lag max ms ≤": share(before, after, 1.0),
            "over 20 ms, %": 100 * (1 - (after[0.02] - before[0.02]) / total),
            "loop busy, %": 100 * (self._busy_s() - busy_s) / took_s,
            "honest rounds": len(rounds),
            "upload s": median(one.upload for one in rounds),
            "ranking s": median(one.ranking for one in rounds),
        }

    def _busy_s(self) -> float:
        """Processor time of the thread that runs the gateway's event loop (Linux)."""
        (pid,) = self.service.processes(GATEWAY)
        return int(Path(f"/proc/{pid}/task/{pid}/schedstat").read_text().split()[0]) / 1e9


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--rate", type=float, default=100)
    parser.add_argument("--connections", type=int, default=20)
    parser.add_argument("--no-budget", action="store_true")
    parser.add_argument("--proxy", action="store_true")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    for budget in (None, _NO_BUDGET) if given.no_budget else (None,):
        named = {"budget": "default" if budget is None else "none"}
        with (
            tempfile.TemporaryDirectory() as folder,
            Benchmark.running(Path(folder), budget, given.proxy) as benchmark,
        ):
            quiet = benchmark.alone(given.seconds / 5)
            hostile = benchmark.attacked(given.seconds, given.rate, given.connections)
        for part in ("upload", "ranking"):
            hostile[f"{part} slowdown"] = hostile[f"{part} s"] / quiet[f"{part} s"]
        rows += [{"phase": "alone", **named, **quiet}, {"phase": "hostile", **named, **hostile}]
    report("Hostile requests", rows, given.json)


if __name__ == "__main__":
    main()
