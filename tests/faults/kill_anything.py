"""Kill parts of the service with SIGKILL while it works, and see whether anything is lost.

    python tests/faults/kill_anything.py --kills 30

A small made-up scene is first taken through the service in peace: an update with the first photographs, one
with the rest, and a fine model. Then the same is done again and again, while processes of the service
(gateway, workers, runners, structure from motion's child) are killed at random moments, and rankings are
asked for all the time. Afterwards:

* every job has succeeded, in its first attempt, and ended once;
* its snapshot is there once, and its Gaussians are those of the peaceful run, bit by bit;
* every image is there once;
* every ranking was answered from the snapshot that was the last one, though it may have taken retries.
"""

import argparse
import contextlib
import hashlib
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx2

from fvs_engine.monitor import Monitor
from fvs_engine.simulate import SimulatedCamera, courtyard, orbit, write_photographs

TARGETS = {
    "gateway": "fvs_service.serving.gateway_process",
    "worker": "fvs_service.serving.worker_process",
    "runner": "fvs_service.worker.runner.process",
    "sfm": "fvs_engine.sfm.native_child",
}
SETTINGS = {
    "FVS_WORKER__INITIAL_ITERATIONS": "200",
    "FVS_WORKER__ITERATIONS_PER_IMAGE": "50",
    "FVS_WORKER__LONG_SIDE_PX": "160",
    "FVS_WORKER__THREADS": "1",  # one thread makes structure from motion repeatable, bit by bit
    "FVS_LEASE_S": "5",
}
FINE_ITERATIONS = 200
KILLS_PER_LIFE = 8
PATIENCE_S = 900.0


@dataclass
class Service:
    """``fvs serve`` in a folder, with a client that tries again what a killed gateway did not answer."""

    root: Path
    workers: int
    process: "subprocess.Popen[str]" = field(init=False)
    client: httpx2.Client = field(init=False)

    def __enter__(self) -> "Service":
        command = [
            *(sys.executable, "-c", "from fvs_service.cli import main; main()", "serve", "--log-json"),
            *("--root", str(self.root), "--port", "0", "--workers", str(self.workers)),
        ]
        self.log = self.root.with_suffix(".log").open("w")
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=self.log, text=True, env={**os.environ, **SETTINGS}
        )
        assert self.process.stdout is not None
        url = self.process.stdout.readline().strip()
        if not url:
            raise SystemExit(f"The service did not start: see {self.log.name}")
        self.client = httpx2.Client(base_url=url, timeout=60)
        return self

    def __exit__(self, *_exception: object) -> None:
        self.process.terminate()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()
        self.client.close()
        self.log.close()

    def call(self, method: str, path: str, **options: Any) -> Any:
        """The answer's document; what may be asked again is, until it is answered."""
        until = time.monotonic() + PATIENCE_S
        while True:
            with contextlib.suppress(httpx2.TransportError):
                answer = self.client.request(method, path, **options)
                if answer.is_success:
                    return answer.json()
                if not answer.json().get("retryable"):
                    raise SystemExit(f"{method} {path}: {answer.status_code} {answer.text}")
            if time.monotonic() > until:
                raise SystemExit(f"{method} {path} was not answered for {PATIENCE_S:g} s")
            time.sleep(0.1)

    def children(self) -> Iterator[tuple[str, int]]:
        """Target and process id of everything below the supervisor that can be killed."""
        parents = dict(_processes())
        for pid in parents:
            ancestor = pid
            while ancestor in parents and ancestor != self.process.pid:
                ancestor = parents[ancestor]
            if ancestor == self.process.pid:
                command = _command(pid)
                for target, module in TARGETS.items():
                    if module in command:
                        yield target, pid


@dataclass(eq=False)
class Killer(threading.Thread):
    """Kills a random kind of process at random moments until it has killed so many."""

    service: Service
    kills: int
    mean_pause_s: float
    rng: random.Random
    killed: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        super().__init__(daemon=True)

    def run(self) -> None:
        """Kill."""
        while sum(self.killed.values()) < self.kills:
            time.sleep(self.rng.uniform(0.1, 1.9) * self.mean_pause_s)
            by_target: dict[str, list[int]] = {}
            for target, pid in self.service.children():
                by_target.setdefault(target, []).append(pid)
            if not by_target:
                continue
            # What is rarely there is taken when it is.
            rarest = min(by_target, key=lambda target: self.killed[target])
            target = rarest if self.rng.random() < 0.5 else self.rng.choice(sorted(by_target))
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.rng.choice(by_target[target]), signal.SIGKILL)
                self.killed[target] += 1
                print(f"  kill {sum(self.killed.values()):3d}: {target}", flush=True)


class Ranker(threading.Thread):
    """Asks for rankings of a scene all the time; each must be of the snapshot that was, or became, last."""

    def __init__(self, service: Service, scene: str) -> None:
        super().__init__(daemon=True)
        self._service, self._scene = service, scene
        self._stop_asking = threading.Event()
        self.answered = 0
        self.wrong: list[str] = []
        self.slowest_s = 0.0

    def run(self) -> None:
        """Ask."""
        while not self._stop_asking.wait(0.2):
            before = self._snapshot()
            if before is None:
                continue
            began = time.monotonic()
            ranking = self._service.call("POST", f"/v1/scenes/{self._scene}/rankings", json=QUESTION)
            self.slowest_s = max(self.slowest_s, time.monotonic() - began)
            if ranking["snapshot_id"] not in (before, self._snapshot()) or ranking["total"] != 4:
                self.wrong.append(str(ranking))
            self.answered += 1

    def stop(self) -> None:
        """Ask no more; what was asked is answered first."""
        self._stop_asking.set()
        self.join()

    def _snapshot(self) -> str | None:
        return self._service.call("GET", f"/v1/scenes/{self._scene}")["snapshot_id"]


QUESTION = {"generator": {"kind": "orbit", "count": 4}}


def main() -> None:
    """Run the script; the exit status tells whether all was well."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))  # and take the service along
    with tempfile.TemporaryDirectory(prefix="fvs-faults-") as name:
        folder = Path(name)
        camera = SimulatedCamera.like_a_drone(320, 240)
        poses = orbit(9, turns=0.36)
        photographs = write_photographs(folder / "world", courtyard(), camera, poses, Monitor())
        with Service(folder / "service", options.workers) as service:
            began = time.monotonic()
            peaceful = live(service, photographs)
            peace_s = time.monotonic() - began
            print(f"in peace: {peace_s:.0f} s", flush=True)
            # Often enough to meet every stage, seldom enough that there is something to kill.
            pause_s = peace_s / KILLS_PER_LIFE
            killer = Killer(service, options.kills, pause_s, random.Random(options.seed))
            killer.start()
            rounds = 0
            while killer.is_alive():
                began = time.monotonic()
                require(
                    live(service, photographs) == peaceful, "a model differs from that of the peaceful run"
                )
                rounds += 1
                print(f"round {rounds}: all is well after {time.monotonic() - began:.0f} s", flush=True)
            print(f"{rounds} lives of a scene, killed: {dict(killer.killed)}")


def live(service: Service, photographs: list[Path]) -> list[str]:
    """Take a scene from photographs to a fine model; returns the digests of its models, checked."""
    key = os.urandom(8).hex()
    scene = service.call(
        "POST", "/v1/scenes", json={"name": "faults"}, headers={"Idempotency-Key": f"{key}-scene"}
    )["id"]
    ranker = Ranker(service, scene)
    ranker.start()
    jobs = []
    steps: list[tuple[list[Path], Mapping[str, Any]]] = [
        (photographs[:7], {"kind": "update"}),
        (photographs[7:], {"kind": "update"}),
        ([], {"kind": "fine", "iterations": FINE_ITERATIONS}),
    ]
    for number, (files, request) in enumerate(steps):
        for file in files:
            content = file.read_bytes()
            digest = hashlib.sha256(content).hexdigest()
            service.call("PUT", f"/v1/scenes/{scene}/images/sha256:{digest}", content=content)
        job = service.call(
            "POST",
            f"/v1/scenes/{scene}/jobs",
            json=request,
            headers={"Idempotency-Key": f"{key}-job-{number}"},
        )["id"]
        jobs.append(wait(service, job))
    ranker.stop()
    require(not ranker.wrong, f"rankings were wrong: {ranker.wrong[:2]}")
    require(ranker.answered > 0, "no ranking was answered")
    print(f"  {ranker.answered} rankings, the slowest took {ranker.slowest_s:.1f} s", flush=True)
    check(service, scene, photographs, jobs)
    return [model_of(service, job) for job in jobs]


def wait(service: Service, job: str) -> dict[str, Any]:
    """The job once it has ended; its progress must not fall."""
    progress, until = 0.0, time.monotonic() + PATIENCE_S
    while True:
        found: dict[str, Any] = service.call("GET", f"/v1/jobs/{job}")
        require(found["progress"] >= progress, f"progress fell: {found}")
        progress = found["progress"]
        if found["state"] not in ("queued", "running"):
            require(
                found["state"] == "succeeded" and found["attempt"] == 1, f"a job did not succeed: {found}"
            )
            return found
        require(time.monotonic() < until, f"a job does not end: {found}")
        time.sleep(0.1)


def check(service: Service, scene: str, photographs: list[Path], jobs: list[dict[str, Any]]) -> None:
    """Nothing lost, nothing doubled."""
    images = service.call("GET", f"/v1/scenes/{scene}/images")["items"]
    sent = {"sha256:" + hashlib.sha256(file.read_bytes()).hexdigest() for file in photographs}
    require(len(images) == len(sent) and {image["digest"] for image in images} == sent, "images differ")
    require(all(image["registration"] == "registered" for image in images), "an image was not taken up")
    snapshots = service.call("GET", f"/v1/scenes/{scene}/snapshots")["items"]
    made_by = Counter(snapshot["job_id"] for snapshot in snapshots)
    require(made_by == Counter(job["id"] for job in jobs), f"snapshots per job: {made_by}")
    with contextlib.closing(sqlite3.connect(service.root / "fvs.sqlite3")) as database:
        kinds = "('job.succeeded', 'job.failed', 'job.canceled')"
        query = f"SELECT count(*) FROM events WHERE scene_id = ? AND kind IN {kinds}"
        (ends,) = database.execute(query, (scene,)).fetchone()
    require(ends == len(jobs), f"{len(jobs)} jobs ended {ends} times")


def model_of(service: Service, job: Mapping[str, Any]) -> str:
    """The digest of the Gaussians that a job made."""
    artifacts = service.call("GET", f"/v1/snapshots/{job['snapshot_id']}")["artifacts"]
    return next(artifact["sha256"] for artifact in artifacts if artifact["name"] == "point_cloud.ply")


def require(holds: bool, otherwise: str) -> None:
    """End with a sentence unless it holds."""
    if not holds:
        raise SystemExit(f"FAILED: {otherwise}")


def _processes() -> Iterator[tuple[int, int]]:
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError, IndexError):
                yield int(folder.name), int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])


def _command(pid: int) -> list[str]:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
    return []


if __name__ == "__main__":
    main()
