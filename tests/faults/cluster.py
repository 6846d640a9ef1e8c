"""Many machines: a gateway, a dispatcher, PostgreSQL, an object store, and a Ray cluster with three nodes.

    python tests/faults/cluster.py --minutes 5

The head and each node of the cluster are in a network, a folder and processes of their own. Small synthetic
scenes are updated while every few seconds a node is killed, which then starts anew. One node is frozen until
another one has its jobs, and continued; one is cut off in the same way; the head is killed once. Needs root.
At the end:

* every job succeeded in its first attempt, and ended once; its snapshots were made once;
* what a node had leased when it was frozen, or cut off, others have leased since, so it could commit nothing;
  the processes of its hosts have ended;
* rankings are answered, and every image has its bytes;
* ``fvs doctor`` finds nothing.

It prints how long takeovers took: from a node's loss until each job that it ran has a runner again, and until
that job gets farther than it was.
"""

import argparse
import contextlib
import hashlib
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx2
import psycopg

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "servers"))

from fvs_cluster import FVS, FvsCluster
from ray_cluster import RayMachine

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

PATIENCE_S = 900.0
FIRST_IMAGES, LAST_IMAGES = 6, 12
FINE_ITERATIONS = 300
ENDED = ("succeeded", "failed", "canceled")
RUNNER = "host.runner.process"
_RUNNING = """
    SELECT jobs.id, jobs.scene_id, jobs.stage, jobs.progress, leases.token
    FROM jobs JOIN scene_leases AS leases USING (scene_id)
    WHERE jobs.state = 'running' AND leases.endpoint LIKE %s
"""
_STATE = "SELECT stage, progress, state FROM jobs WHERE id = %s"
_LEASE = "SELECT token, endpoint FROM scene_leases WHERE scene_id = %s"
_EVENTS_OF_JOB = "SELECT count(*) FROM events WHERE scene_id = %s AND kind = ANY(%s) AND data->>'job_id' = %s"


@dataclass
class Lost:
    """A job that lost its node, and how far it was; ``runs``: a new runner has its scene."""

    cause: str
    since: float
    scene: str
    token: int
    reached: tuple[str, float]
    runs: bool = False


class Takeovers(threading.Thread):
    """Measures how long jobs are without a runner after the loss of a node, or of the head.

    ``runs``: until a new runner has the scene. ``progress``: until the job gets farther than it was, which
    repeats what the node had not stored yet. A job that loses its next node before it gets there counts
    from its first loss, as ``again``.
    """

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True)
        self._url, self._done = url, threading.Event()
        self._lost: dict[str, Lost] = {}
        self.seconds: dict[str, list[float]] = defaultdict(list)

    def lost(self, cause: str, address: str) -> dict[str, int]:
        """Record the jobs that run at an address ("": any); returns the tokens of their scenes' leases."""
        with psycopg.connect(self._url) as database:
            rows = database.execute(_RUNNING, (f"%{address}:%",)).fetchall()
        for job, scene, stage, progress, token in rows:
            former = self._lost.get(job)
            if former is None:
                self._lost[job] = Lost(cause, time.monotonic(), scene, token, (stage, progress))
            elif former.runs:  # it ran again, but did not get farther
                self._lost[job] = Lost("again", time.monotonic(), scene, token, former.reached)
            else:
                former.cause, former.token = "again", token
        return {scene: token for _, scene, _, _, token in rows}

    def run(self) -> None:
        """Watch the jobs until stopped."""
        with psycopg.connect(self._url, autocommit=True) as database:
            while not self._done.wait(0.1):
                for job, lost in list(self._lost.items()):
                    took_s = time.monotonic() - lost.since
                    lease = database.execute(_LEASE, (lost.scene,)).fetchone()
                    if not lost.runs and lease is not None and lease[0] > lost.token and lease[1]:
                        lost.runs = True
                        self.seconds[f"runs after {lost.cause}"].append(took_s)
                    row = database.execute(_STATE, (job,)).fetchone()
                    if row is not None and (row[:2] != lost.reached or row[2] in ENDED):
                        self.seconds[f"progress after {lost.cause}"].append(took_s)
                        self._lost.pop(job)

    def stop(self) -> None:
        """Stop watching."""
        self._done.set()
        self.join()


class Clients:
    """A client that repeats requests until they are answered."""

    def __init__(self, url: str) -> None:
        self.client = httpx2.Client(base_url=url, timeout=60)
        self.repeated = 0

    def call(self, method: str, path: str, **options: Any) -> Any:
        """The document of the answer."""
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            with contextlib.suppress(httpx2.TransportError):
                answer = self.client.request(method, path, **options)
                if answer.is_success:
                    return answer.json() if answer.content else None
                if not answer.json().get("retryable"):
                    raise SystemExit(f"{method} {path}: {answer.status_code} {answer.text}")
            self.repeated += 1
            time.sleep(0.2)
        raise SystemExit(f"{method} {path} was not answered for {PATIENCE_S:g} s")


def main() -> None:
    """Run the script; the exit status is 0 when all checks hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0, help="how long there are faults")
    parser.add_argument("--scenes", type=int, default=8)
    parser.add_argument("--nodes", type=int, default=3)
    parser.add_argument("--every", type=float, default=10.0, metavar="S", help="time between two kills")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, help="a new folder to work in, which is kept with all logs")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))
    with contextlib.ExitStack() as stack:
        folder = options.folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fvs-many-")))
        cluster = stack.enter_context(
            FvsCluster(folder, options.nodes, cpus=-(-options.scenes // (options.nodes - 1)))
        )
        Run(cluster, folder, options).run()


class Run:
    """The scenes of a cluster, and the faults."""

    def __init__(self, cluster: FvsCluster, folder: Path, options: argparse.Namespace) -> None:
        self._cluster, self._options = cluster, options
        self._rng = random.Random(options.seed)
        self._clients = Clients(cluster.url)
        camera = SimulatedCamera.like_a_drone(320, 240)
        poses = orbit(LAST_IMAGES, turns=0.48)
        self._photographs = write_photographs(folder / "world", courtyard(), camera, poses, Monitor())
        self._jobs: dict[str, list[str]] = {}
        self._takeovers = Takeovers(cluster.database_url)
        self._faults: dict[str, int] = defaultdict(int)
        self._began = time.monotonic()

    @property
    def _passed_s(self) -> float:
        return time.monotonic() - self._began

    def _say(self, what: str) -> None:
        print(f"{self._passed_s:6.1f} s  {what}", flush=True)

    def run(self) -> None:
        """Cause the faults, and check what they left."""
        takeovers = self._takeovers
        takeovers.start()
        for number in range(self._options.scenes):
            scene = self._make_scene(number)
            self._jobs[scene] = [self._start(scene, {"kind": "update"})]
        self._began = time.monotonic()
        end = self._options.minutes * 60
        others = {0.2 * end: self._freeze, 0.5 * end: self._kill_head, 0.8 * end: self._cut}
        due = self._options.every
        while self._passed_s < end:
            self._go_on()
            if others and self._passed_s > min(others):
                others.pop(min(others))()
            elif self._passed_s > due:
                due = self._passed_s + self._options.every
                self._kill_node()
            self._cluster.restart_lost()
            time.sleep(0.2)
        self._say("no more faults")
        while not all(self._state(job) in ENDED for jobs in self._jobs.values() for job in jobs):
            self._cluster.restart_lost()
            require(self._passed_s < end + PATIENCE_S, "a job does not end")
            time.sleep(0.5)
        self._say("all jobs have ended")
        takeovers.stop()
        self._check()
        self._say("all checks hold")
        self._report()

    def _report(self) -> None:
        total = sum(map(len, self._jobs.values()))
        faults = ", ".join(f"{count} × {fault}" for fault, count in self._faults.items())
        print(f"{faults}; {total} jobs of {len(self._jobs)} scenes ended once each", flush=True)
        print(f"{self._clients.repeated} requests were repeated", flush=True)
        for cause, seconds in self._takeovers.seconds.items():
            ordered = sorted(seconds)
            p90 = ordered[int(0.9 * (len(ordered) - 1))]
            print(
                f"{cause}: {len(ordered)}, median {statistics.median(ordered):.1f} s, "
                f"p90 {p90:.1f} s, longest {ordered[-1]:.1f} s",
                flush=True,
            )

    def _kill_node(self) -> None:
        up = [node for node in self._cluster.ray.nodes if node.is_up]
        if not up:
            return
        node = self._rng.choice(up)
        jobs = self._takeovers.lost("kill", node.host.address)
        node.kill()
        self._faults["node killed"] += 1
        self._say(f"{node.folder.name} killed with {len(jobs)} jobs")

    def _kill_head(self) -> None:
        jobs = self._takeovers.lost("head", "")
        self._cluster.ray.head.kill()
        self._faults["head killed"] += 1
        self._say(f"the head killed, {len(jobs)} jobs run")

    def _freeze(self) -> None:
        node = self._busy_node()
        jobs = self._takeovers.lost("freeze", node.host.address)
        node.freeze()
        self._silenced(node, jobs, "frozen")
        node.thaw()
        self._ends(node)

    def _cut(self) -> None:
        node = self._busy_node()
        jobs = self._takeovers.lost("cut", node.host.address)
        node.host.cut()
        self._silenced(node, jobs, "cut off")
        node.host.join()
        self._ends(node)

    def _busy_node(self) -> RayMachine:
        """A node that runs a job; the others are up."""
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            self._cluster.restart_lost()
            self._go_on()
            with psycopg.connect(self._cluster.database_url) as database:
                busy = [
                    node
                    for node in self._cluster.ray.nodes
                    if database.execute(_RUNNING, (f"%{node.host.address}:%",)).fetchone()
                ]
            if busy and all(node.is_up for node in self._cluster.ray.nodes):
                return busy[0]
            time.sleep(0.2)
        raise SystemExit("FAILED: no node does anything")

    def _silenced(self, node: RayMachine, tokens: dict[str, int], how: str) -> None:
        """Wait until others have leased what the node had."""
        self._faults[f"node {how}"] += 1
        self._say(f"{node.folder.name} {how} with {len(tokens)} jobs")
        began = time.monotonic()
        with psycopg.connect(self._cluster.database_url, autocommit=True) as database:
            while not all(
                database.execute(_LEASE, (scene,)).fetchone()[0] > token  # type: ignore[index]
                for scene, token in tokens.items()
            ):
                require(time.monotonic() - began < PATIENCE_S, f"nobody takes the jobs of {node.folder.name}")
                self._go_on()
                time.sleep(0.1)
        self._say(f"others have leased its scenes {time.monotonic() - began:.1f} s later")

    def _ends(self, node: RayMachine) -> None:
        began = time.monotonic()
        while node.processes(RUNNER):
            require(time.monotonic() - began < 60, f"the runners of {node.folder.name} go on")
            time.sleep(0.05)
        self._say(f"back again, its runners ended after {time.monotonic() - began:.1f} s")

    def _make_scene(self, number: int) -> str:
        scene: str = self._clients.call(
            "POST",
            "/v1/scenes",
            json={"name": f"scene {number}"},
            headers={"Idempotency-Key": f"scene-{number}"},
        )["id"]
        self._send(scene, self._photographs[:FIRST_IMAGES])
        return scene

    def _send(self, scene: str, photographs: Sequence[Path]) -> None:
        for file in photographs:
            content = file.read_bytes()
            self._clients.call("PUT", f"/v1/scenes/{scene}/images/{digest_of(content)}", content=content)

    def _start(self, scene: str, request: dict[str, Any]) -> str:
        key = {"Idempotency-Key": f"{scene}-{len(self._jobs.get(scene, ()))}"}
        job: str = self._clients.call("POST", f"/v1/scenes/{scene}/jobs", json=request, headers=key)["id"]
        return job

    def _state(self, job: str) -> str:
        state: str = self._clients.call("GET", f"/v1/jobs/{job}")["state"]
        return state

    def _go_on(self) -> None:
        """Start the next job of every scene whose last one has ended: an update, later a fine model."""
        for scene, jobs in self._jobs.items():
            if self._state(jobs[-1]) not in ENDED:
                continue
            next_image = FIRST_IMAGES - 1 + len(jobs)
            if next_image < LAST_IMAGES:
                self._send(scene, [self._photographs[next_image]])
                jobs.append(self._start(scene, {"kind": "update"}))
            else:
                jobs.append(self._start(scene, {"kind": "fine", "iterations": FINE_ITERATIONS}))

    def _check(self) -> None:
        """Check that no job, image or snapshot is lost or made twice."""
        sent = {digest_of(file.read_bytes()) for file in self._photographs}
        with psycopg.connect(self._cluster.database_url) as database:

            def count(scene: str, job: str, *kinds: str) -> int:
                row = database.execute(_EVENTS_OF_JOB, (scene, list(kinds), job)).fetchone()
                return 0 if row is None else row[0]

            for scene, jobs in self._jobs.items():
                images = self._clients.call("GET", f"/v1/scenes/{scene}/images")["items"]
                require({image["digest"] for image in images} <= sent, "images differ")
                expected = min(FIRST_IMAGES - 1 + len(jobs), LAST_IMAGES)
                require(len(images) == expected, f"{scene} has {len(images)} images")
                for image in images:
                    path = f"/v1/scenes/{scene}/images/{image['digest']}/content"
                    require(
                        digest_of(self._clients.client.get(path).content) == image["digest"], "bytes differ"
                    )
                for job in jobs:
                    found = self._clients.call("GET", f"/v1/jobs/{job}")
                    require(found["state"] == "succeeded" and found["attempt"] == 1, f"failed: {found}")
                    require(count(scene, job, *(f"job.{end}" for end in ENDED)) == 1, f"{job} ended often")
                    made = count(scene, job, "snapshot.created")
                    most = 2 if found["kind"] == "update" else 1  # a full model, and perhaps a quick one
                    require(1 <= made <= most, f"{job} made {made} models instead of {most}")
                question = {"generator": {"kind": "orbit", "count": 4}}
                ranking = self._clients.call("POST", f"/v1/scenes/{scene}/rankings", json=question)
                require(ranking["total"] == 4, f"a ranking is wrong: {ranking}")
        with tempfile.TemporaryDirectory() as root:
            doctor = subprocess.run(
                [*FVS, "doctor", "--root", root],
                env={**os.environ, **self._cluster.settings},
                capture_output=True,
                text=True,
                check=False,
            )
        require(doctor.returncode == 0, f"the doctor finds {doctor.stdout}{doctor.stderr}")


def digest_of(content: bytes) -> str:
    """The digest of an image, as in its URL."""
    return "sha256:" + hashlib.sha256(content).hexdigest()


def require(holds: bool, otherwise: str) -> None:
    """Exit unless a check holds."""
    if not holds:
        raise SystemExit(f"FAILED: {otherwise}")


if __name__ == "__main__":
    main()
