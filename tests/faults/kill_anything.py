"""Kill processes of the service with SIGKILL at every stage, and check that nothing is lost.

    python tests/faults/kill_anything.py

A small synthetic scene is processed undisturbed first: an update with the first photographs, one with the
rest, and a fine model. This shows which processes exist at which stage. The same is then repeated while
every kind of process (gateway, worker, runner, SfM child) is killed at every stage at which it exists, at a
random moment of the stage, and while a client requests rankings. The scene keeps two snapshots and ten
rankings, an update without new images follows, a second scene is deleted while its first job runs, and at the
end the first one is deleted. After each repetition:

* every job has succeeded in its first attempt, and ended once;
* its snapshots were made once, and the Gaussians of the last are bit-identical to those of the undisturbed
  run;
* every image exists once, with its bytes;
* the snapshots and rankings are those that the retention keeps;
* every ranking was answered from the snapshot that was the latest, possibly after retries;
* deleted scenes are gone at once, and from the disk soon after; ``fvs doctor`` finds nothing;
* no process survives outside the service's control.

At the end it prints how often each kind of process was killed at each stage.
"""

import argparse
import contextlib
import hashlib
import json
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
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx2
from killer import Killer, Watch, choose_aims

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

LEASE_S = 5.0
SETTINGS = {
    "FVS_WORKER__INITIAL_ITERATIONS": "120",
    "FVS_WORKER__ITERATIONS_PER_IMAGE": "30",
    "FVS_WORKER__LONG_SIDE_PX": "160",
    "FVS_WORKER__THREADS": "1",  # one thread makes structure from motion repeatable, bit by bit
    "FVS_LEASE_S": f"{LEASE_S:g}",
    "FVS_SWEEP_S": "1",
    "FVS_REMOVAL_GRACE_S": "5",
    "FVS_RETENTION__RANKINGS": "10",
}
RETENTION = {"snapshots": 2}
FINE_ITERATIONS = 150
MOST_LIVES = 25
PATIENCE_S = 900.0


@dataclass
class Service:
    """``fvs serve`` in a folder, with a client that repeats requests that a killed gateway did not answer."""

    root: Path
    workers: int
    process: "subprocess.Popen[str]" = field(init=False)
    client: httpx2.Client = field(init=False)

    def __enter__(self) -> "Service":
        command = [
            *(sys.executable, "-c", "from fvs_engine.cli import main; main()", "serve", "--log-json"),
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
        """The document of the response; repeatable requests are repeated until they are answered."""
        until = time.monotonic() + PATIENCE_S
        while True:
            with contextlib.suppress(httpx2.TransportError):
                answer = self.client.request(method, path, **options)
                if answer.is_success:
                    return answer.json() if answer.content else None
                if method == "DELETE" and answer.status_code == 404:
                    return None  # an earlier request deleted it, and its answer was lost
                if not answer.json().get("retryable"):
                    raise SystemExit(f"{method} {path}: {answer.status_code} {answer.text}")
            if time.monotonic() > until:
                raise SystemExit(f"{method} {path} was not answered for {PATIENCE_S:g} s")
            time.sleep(0.1)


class Ranker(threading.Thread):
    """Requests rankings in a loop; each must be of the snapshot that was, or became, the latest."""

    def __init__(self, service: Service, scene: str) -> None:
        super().__init__(daemon=True)
        self._service, self._scene = service, scene
        self._stop_asking = threading.Event()
        self.answered = 0
        self.wrong: list[str] = []
        self.slowest_s = 0.0

    def run(self) -> None:
        """Request rankings until stopped."""
        while not self._stop_asking.wait(0.5):
            try:
                self._ask()
            except SystemExit as refused:
                self.wrong.append(str(refused))

    def _ask(self) -> None:
        before = self._snapshot()
        if before is None:
            return
        began = time.monotonic()
        ranking = self._service.call("POST", f"/v1/scenes/{self._scene}/rankings", json=QUESTION)
        self.slowest_s = max(self.slowest_s, time.monotonic() - began)
        if ranking["snapshot_id"] not in (before, self._snapshot()) or ranking["total"] != 4:
            self.wrong.append(str(ranking))
        self.answered += 1

    def stop(self) -> None:
        """Stop after the request in progress is answered."""
        self._stop_asking.set()
        self.join()

    def _snapshot(self) -> str | None:
        return self._service.call("GET", f"/v1/scenes/{self._scene}")["snapshot_id"]


QUESTION = {"generator": {"kind": "orbit", "count": 4}}


def main() -> None:
    """Run the script; the exit status is 0 when all checks hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--kills", type=int, help="default: one for every process at every stage")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, help="a new folder to work in, which is kept with all logs")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))  # and take the service along
    rng = random.Random(options.seed)
    with contextlib.ExitStack() as stack:
        folder = options.folder or Path(
            stack.enter_context(tempfile.TemporaryDirectory(prefix="fvs-faults-"))
        )
        camera = SimulatedCamera.like_a_drone(320, 240)
        poses = orbit(9, turns=0.36)
        photographs = write_photographs(folder / "world", courtyard(), camera, poses, Monitor())
        service = stack.enter_context(Service(folder / "service", options.workers))
        watch = Watch(service.process.pid, service.root / "fvs.sqlite3")
        killer = stack.enter_context(Killer(watch, rng))
        peaceful = live(service, photographs)
        killer.aim_at(choose_aims(killer.seen_s, options.kills, rng))
        print(f"{len(killer.left)} kills are planned", flush=True)
        lives = 0
        while killer.left and lives < MOST_LIVES:
            models = live(service, photographs)
            require(models == peaceful, f"models {models} differ from those of the peaceful run, {peaceful}")
            require_no_orphans(watch)
            require_health(service)
            lives += 1
            print(f"repetition {lives}: all checks hold, {len(killer.left)} kills are left", flush=True)
        print(killer.table())
        print(f"{killer.killed.total()} kills in {lives} repetitions, {options.workers} workers", flush=True)
        require(not killer.left, f"there was no occasion for {killer.left}")


def live(service: Service, photographs: list[Path]) -> list[str]:
    """Take a scene from photographs to a fine model; returns the digests of its models, checked."""
    key = os.urandom(8).hex()
    scene = service.call(
        "POST",
        "/v1/scenes",
        json={"name": "faults", "retention": RETENTION},
        headers={"Idempotency-Key": f"{key}-scene"},
    )["id"]
    began = time.monotonic()
    ranker = Ranker(service, scene)
    ranker.start()
    jobs, models = [], []
    steps: list[tuple[list[Path], Mapping[str, Any]]] = [
        (photographs[:7], {"kind": "update"}),
        (photographs[7:], {"kind": "update"}),
        ([], {"kind": "update"}),
        ([], {"kind": "fine", "iterations": FINE_ITERATIONS}),
    ]
    for number, (files, request) in enumerate(steps):
        send(service, scene, files)
        job = service.call(
            "POST",
            f"/v1/scenes/{scene}/jobs",
            json=request,
            headers={"Idempotency-Key": f"{key}-job-{number}"},
        )["id"]
        jobs.append(wait(service, job))
        models.append(model_of(service, jobs[-1]))  # now: retention deletes it later
    ranker.stop()
    require(not ranker.wrong, f"rankings were wrong: {ranker.wrong[:2]}")
    require(ranker.answered > 0, "no ranking was answered")
    print(
        f"  lived for {time.monotonic() - began:.0f} s; "
        f"{ranker.answered} rankings, the slowest took {ranker.slowest_s:.1f} s",
        flush=True,
    )
    check(service, scene, photographs, jobs)
    delete_while_a_job_runs(service, photographs[:7], key)
    delete(service, scene)
    return models


def send(service: Service, scene: str, files: list[Path]) -> None:
    """Upload photographs."""
    for file in files:
        content = file.read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        service.call("PUT", f"/v1/scenes/{scene}/images/sha256:{digest}", content=content)


def delete_while_a_job_runs(service: Service, photographs: list[Path], key: str) -> None:
    """Delete a scene once its first job has begun."""
    scene = service.call(
        "POST", "/v1/scenes", json={"name": "doomed"}, headers={"Idempotency-Key": f"{key}-doomed"}
    )["id"]
    send(service, scene, photographs)
    job = service.call("POST", f"/v1/scenes/{scene}/jobs", json={"kind": "update"})["id"]
    until = time.monotonic() + PATIENCE_S
    while service.call("GET", f"/v1/jobs/{job}")["stage"] is None and time.monotonic() < until:
        time.sleep(0.1)
    delete(service, scene)


def delete(service: Service, scene: str) -> None:
    """Delete a scene: it is gone at once, and leaves nothing on the disk."""
    service.call("DELETE", f"/v1/scenes/{scene}")
    listed = service.call("GET", "/v1/scenes?limit=1000")["items"]
    require(scene not in [item["id"] for item in listed], "a deleted scene is listed")
    until = time.monotonic() + PATIENCE_S
    while left := on_disk(service.root, scene):
        require(time.monotonic() < until, f"a deleted scene is on the disk: {left}")
        time.sleep(0.5)


def on_disk(root: Path, scene: str) -> list[Path]:
    """The folders of a scene; other folders may vanish meanwhile."""
    return [Path(folder) for folder, _, _ in os.walk(root) if Path(folder).name == scene]


def require_health(service: Service) -> None:
    """Check that ``fvs doctor`` finds nothing."""
    command = [sys.executable, "-c", "from fvs_engine.cli import main; main()", "doctor", "--grace", "60"]
    checked = subprocess.run(
        [*command, "--root", str(service.root)], capture_output=True, text=True, check=False
    )
    require(checked.returncode == 0, f"the doctor finds {checked.stdout or checked.stderr}")


def wait(service: Service, job: str) -> dict[str, Any]:
    """Wait until the job has ended, and return it; its progress must not decrease."""
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
    """Check that no job, image or snapshot is lost or stored twice."""
    images = service.call("GET", f"/v1/scenes/{scene}/images")["items"]
    sent = {"sha256:" + hashlib.sha256(file.read_bytes()).hexdigest() for file in photographs}
    require(len(images) == len(sent) and {image["digest"] for image in images} == sent, "images differ")
    require(all(image["registration"] == "registered" for image in images), "an image was not taken up")
    for image in images:
        name = image["digest"].removeprefix("sha256:")
        content = (service.root / "blobs" / "scenes" / scene / "images" / name).read_bytes()
        require(hashlib.sha256(content).hexdigest() == name, f"an image has other bytes: {image}")
    first, second, again, fine = jobs
    require(again["snapshot_id"] == second["snapshot_id"], f"an update without images made a model: {again}")
    until = time.monotonic() + PATIENCE_S
    while True:
        left = [item["id"] for item in service.call("GET", f"/v1/scenes/{scene}/snapshots")["items"]]
        if left == [fine["snapshot_id"], second["snapshot_id"]]:  # the newest first
            break
        require(time.monotonic() < until, f"retention left {left}")
        time.sleep(0.5)
    with contextlib.closing(sqlite3.connect(service.root / "fvs.sqlite3", timeout=30)) as database:
        query = "SELECT data FROM events WHERE scene_id = ? AND kind = 'snapshot.created'"
        made = Counter(json.loads(data)["job_id"] for (data,) in database.execute(query, (scene,)))
        expected = Counter({first["id"]: 2, second["id"]: 2, fine["id"]: 1})  # quick and full; fine
        require(made == expected, f"snapshots per job: {made}")
        kinds = "('job.succeeded', 'job.failed', 'job.canceled')"
        query = f"SELECT count(*) FROM events WHERE scene_id = ? AND kind IN {kinds}"
        (ends,) = database.execute(query, (scene,)).fetchone()
    require(ends == len(jobs), f"{len(jobs)} jobs ended {ends} times")
    last = service.call("POST", f"/v1/scenes/{scene}/rankings", json=QUESTION)
    require(last["snapshot_id"] == jobs[-1]["snapshot_id"], f"the last model does not rank: {last}")


def require_no_orphans(watch: Watch) -> None:
    """Check that orphaned processes end within a lease."""
    until = time.monotonic() + LEASE_S
    while orphans := watch.orphans():
        require(time.monotonic() < until, f"processes were left behind: {watch.describe(orphans)}")
        time.sleep(0.1)


def model_of(service: Service, job: Mapping[str, Any]) -> str:
    """The digest of the Gaussians that a job made."""
    artifacts = service.call("GET", f"/v1/snapshots/{job['snapshot_id']}")["artifacts"]
    return next(artifact["sha256"] for artifact in artifacts if artifact["name"] == "point_cloud.ply")


def require(holds: bool, otherwise: str) -> None:
    """Exit with a message unless the condition holds."""
    if not holds:
        raise SystemExit(f"FAILED: {otherwise}")


if __name__ == "__main__":
    main()
