"""Several machines: PostgreSQL, an object store, two gateways and two workers that share no folder.

    python tests/faults/many_machines.py --minutes 5

Every part is a process with a folder of its own; gateways and workers know each other by the database alone,
and each worker's runners listen on an address of its own (127.0.0.2, 127.0.0.3). Small synthetic scenes are
updated, through either gateway, while a worker is killed every few seconds, one is frozen for longer than its
lease and continued, PostgreSQL crashes and restarts, and the object store is away for 20 s. With ``--skew``
the clocks of the second gateway and the second worker are ahead by that time. With ``--namespaces`` each
machine is in a network of its own, calls have keys, and a worker is cut off for longer than its lease. At the
end:

* every job succeeded in its first attempt, and ended once; its snapshot was made once;
* the worker that was frozen, or cut off, has committed nothing after it lost its leases, and ended;
* both gateways return the same, rankings are answered through either, and every image has its bytes;
* ``fvs doctor`` finds nothing.

It prints how long each takeover took: from a worker's kill to the next progress of a job that it ran.
"""

import argparse
import contextlib
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2
import psycopg

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "servers"))

from machine import FVS, LEASE_S, SETTINGS, Machine
from network import Network
from object_store_server import ACCESS_KEY_ID, SECRET_ACCESS_KEY, ObjectStoreServer
from postgresql_server import PostgresqlServer

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

STORE_AWAY_S = 20.0
PATIENCE_S = 900.0
_EVENTS_OF_JOB = "SELECT count(*) FROM events WHERE scene_id = %s AND kind = ANY(%s) AND data->>'job_id' = %s"
_WORKER, _RUNNER = "serving.process worker", "host.runner.process"
ENDED = ("succeeded", "failed", "canceled")


class Clients:
    """Clients of both gateways, used in turn; requests are repeated until they are answered."""

    def __init__(self, urls: list[str], headers: dict[str, str]) -> None:
        self.clients = [httpx2.Client(base_url=url, headers=headers, timeout=60) for url in urls]
        self._turn = 0
        self.failed = 0

    def call(self, method: str, path: str, **options: Any) -> Any:
        """The document of the answer."""
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            self._turn += 1
            with contextlib.suppress(httpx2.TransportError):
                answer = self.clients[self._turn % len(self.clients)].request(method, path, **options)
                if answer.is_success:
                    return answer.json() if answer.content else None
                if not answer.json().get("retryable"):
                    raise SystemExit(f"{method} {path}: {answer.status_code} {answer.text}")
            self.failed += 1
            time.sleep(0.2)
        raise SystemExit(f"{method} {path} was not answered for {PATIENCE_S:g} s")


class Takeovers(threading.Thread):
    """Measures from the kill of a worker to the next progress of each job that it ran."""

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True)
        self._url, self._lost, self._done = url, {}, threading.Event()
        self.seconds: list[float] = []

    def lost(self, worker: str) -> None:
        """Record the jobs of a worker that is about to be killed."""
        with contextlib.suppress(psycopg.Error), psycopg.connect(self._url, connect_timeout=2) as database:
            rows = database.execute(
                "SELECT id, stage, progress FROM jobs WHERE state = 'running' AND worker_id = %s", (worker,)
            )
            for job, stage, progress in rows.fetchall():
                self._lost.setdefault(job, (time.monotonic(), stage, progress))

    def run(self) -> None:
        """Watch the jobs until stopped."""
        while not self._done.wait(0.1):
            with (
                contextlib.suppress(psycopg.Error),
                psycopg.connect(self._url, connect_timeout=2) as database,
            ):
                for job, (since, stage, progress) in list(self._lost.items()):
                    row = database.execute(
                        "SELECT stage, progress, state FROM jobs WHERE id = %s", (job,)
                    ).fetchone()
                    if row is not None and (row[:2] != (stage, progress) or row[2] in ENDED):
                        self.seconds.append(time.monotonic() - since)
                        del self._lost[job]

    def stop(self) -> None:
        """Stop watching."""
        self._done.set()
        self.join()


def is_known(url: str, worker: str) -> bool:
    """Whether no other worker has declared this one dead."""
    with psycopg.connect(url) as database:
        return database.execute("SELECT 1 FROM workers WHERE id = %s", (worker,)).fetchone() is not None


def main() -> None:
    """Run the script; the exit status is 0 when all checks hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0, help="how long there are faults")
    parser.add_argument("--scenes", type=int, default=8)
    parser.add_argument("--every", type=float, default=15.0, metavar="S", help="time between two kills")
    parser.add_argument("--skew", type=int, default=0, metavar="S", help="of the second machines' clocks")
    parser.add_argument("--namespaces", action="store_true", help="a network for each machine; needs root")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, help="a new folder to work in, which is kept with all logs")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))
    with contextlib.ExitStack() as stack:
        folder = options.folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fvs-many-")))
        run(folder, options, stack)


def run(folder: Path, options: argparse.Namespace, stack: contextlib.ExitStack) -> None:
    """Start the machines, cause the faults, and check what they left."""
    rng = random.Random(options.seed)
    network = stack.enter_context(Network()) if options.namespaces else None
    here = network.address if network is not None else "127.0.0.1"
    database = PostgresqlServer(folder / "postgresql", here)
    database.start()
    stack.callback(lambda: database.stop())
    store = ObjectStoreServer(folder / "store", here)
    store.start()
    stack.callback(lambda: store.stop())
    store.create_bucket("fvs")
    shared = {
        "FVS_DATABASE_URL": database.create_database("fvs"),
        "FVS_BLOBS__URL": "s3://fvs/service",
        "FVS_BLOBS__ENDPOINT": store.endpoint,
        "FVS_BLOBS__REGION": "us-east-1",
        "FVS_BLOBS__ACCESS_KEY_ID": ACCESS_KEY_ID,
        "FVS_BLOBS__SECRET_ACCESS_KEY": SECRET_ACCESS_KEY,
    }
    headers = {"Authorization": f"Bearer {new_key(folder, shared)}"} if network is not None else {}
    skews_s = {1: 0, 2: options.skew}
    gateways, workers = [], []
    for number, skew_s in skews_s.items():
        place = network.host() if network is not None else here
        gateways.append(Machine(folder / f"gateway-{number}", "gateway", shared, place, skew_s))
        stack.callback(gateways[-1].kill)  # at once: the next may fail to start
    for number, skew_s in skews_s.items():
        place = network.host() if network is not None else f"127.0.0.{number + 1}"
        workers.append(Machine(folder / f"worker-{number}", "worker", shared, place, skew_s))
        stack.callback(workers[-1].kill)
    clients = Clients([gateway.url for gateway in gateways], headers)
    photographs = write_photographs(
        folder / "world", courtyard(), SimulatedCamera.like_a_drone(320, 240), orbit(9, turns=0.36), Monitor()
    )
    takeovers = Takeovers(shared["FVS_DATABASE_URL"])
    takeovers.start()
    scenes = [make_scene(clients, photographs[:6], number) for number in range(options.scenes)]
    jobs = {scene: [start(clients, scene, f"first-{scene}")] for scene in scenes}
    began = time.monotonic()
    say = lambda what: print(f"{time.monotonic() - began:6.1f} s  {what}", flush=True)  # noqa: E731
    faults = iter(("postgresql", "store", "freeze", *(("cut",) if network is not None else ())))
    kills, due, other_due = 0, options.every, options.minutes * 60 / 5
    was_frozen = False
    back: list[tuple[float, Machine]] = []
    while (passed := time.monotonic() - began) < options.minutes * 60:
        go_on(clients, jobs, photographs)
        if passed > other_due:
            other_due += options.minutes * 60 / 5
            match next(faults, None):
                case "postgresql":
                    database.stop()
                    say("PostgreSQL has crashed")
                    time.sleep(2)
                    database.start()
                    say("PostgreSQL is back")
                case "store":
                    store.stop()
                    say("the object store is away")
                    time.sleep(STORE_AWAY_S)
                    store.start()
                    say("the object store is back")
                case "freeze" | "cut" as kind:
                    for _, machine in back:  # somebody has to take the jobs
                        machine.start()
                    back.clear()
                    busy = wait_for_worker(workers, lambda: go_on(clients, jobs, photographs))
                    silence(kind, busy, shared["FVS_DATABASE_URL"], takeovers, say)
                    was_frozen = True
        elif passed > due:
            due = passed + options.every
            victim = rng.choice(workers)
            takeovers.lost(victim.name)
            whole = rng.random() < 0.5  # the machine, else only the process
            found = victim.processes(_WORKER)
            if whole:
                victim.kill()
            for pid in found if not whole else ():
                os.kill(pid, signal.SIGKILL)
            kills += bool(found)
            say(f"killed {'machine' if whole else 'process'} {victim.name}")
            if whole:
                back.append((passed + 2 * options.every / 3, victim))
        for when, machine in [item for item in back if passed > item[0]]:
            back.remove((when, machine))
            machine.start()
        for machine in workers:  # as an init system does
            if machine.process.poll() is not None and machine not in [down for _, down in back]:
                back.append((passed + 2, machine))
        time.sleep(0.2)
    say("no more faults")
    time.sleep(options.every)
    while not all(
        clients.call("GET", f"/v1/jobs/{job}")["state"] in ENDED for of in jobs.values() for job in of
    ):
        require(time.monotonic() - began < options.minutes * 60 + PATIENCE_S, "a job does not end")
        time.sleep(0.5)
    say("all jobs have ended")
    takeovers.stop()
    check(shared, clients, jobs, photographs, was_frozen)
    say("all checks hold")
    seconds = sorted(takeovers.seconds)
    total = sum(map(len, jobs.values()))
    took = f"median {seconds[len(seconds) // 2]:.1f} s, longest {seconds[-1]:.1f} s" if seconds else "none"
    print(f"{kills} kills; {total} jobs of {len(jobs)} scenes ended once each", flush=True)
    print(f"{clients.failed} requests were repeated; {len(seconds)} takeovers: {took}", flush=True)
    for machine in (*gateways, *workers):
        machine.stop()


def wait_for_worker(workers: list[Machine], give_work: Callable[[], None]) -> Machine:
    """A machine whose worker has a runner; until there is one, ``give_work`` is called."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        for machine in workers:
            if machine.processes(_WORKER) and machine.processes(_RUNNER):
                return machine
        give_work()
        time.sleep(0.1)
    raise SystemExit("FAILED: no worker does anything")


def silence(kind: str, machine: Machine, url: str, takeovers: Takeovers, say: Callable[[str], None]) -> None:
    """Freeze a worker, or cut its machine off, until another one has its jobs; back again, it must end."""
    found = machine.processes(_WORKER)
    takeovers.lost(machine.name)
    if kind == "cut" and machine.host is not None:
        machine.host.cut()
    else:
        send_to(found, signal.SIGSTOP)
    say(f"{machine.name}: {kind}")
    began = time.monotonic()
    while is_known(url, machine.name):
        require(time.monotonic() - began < PATIENCE_S, f"nobody takes the jobs of {machine.name}")
        time.sleep(0.1)
    say(f"its jobs were taken {time.monotonic() - began:.1f} s later")
    time.sleep(LEASE_S)
    if kind == "cut" and machine.host is not None:
        machine.host.join()
    else:
        send_to(found, signal.SIGCONT)
    began = time.monotonic()
    while set(found) & set(machine.processes(_WORKER)):
        require(time.monotonic() - began < 60, f"{machine.name} goes on")
        time.sleep(0.05)
    say(f"back again, it ended after {time.monotonic() - began:.1f} s")


def send_to(processes: list[int], number: signal.Signals) -> None:
    """Send a signal."""
    for pid in processes:
        os.kill(pid, number)


def new_key(folder: Path, shared: dict[str, str]) -> str:
    """A key for all calls."""
    created = subprocess.run(
        [*FVS, "keys", "create", "faults", "--root", str(folder / "keys")],
        env={**os.environ, **SETTINGS, **shared},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return created.stdout.strip()


def make_scene(clients: Clients, photographs: list[Path], number: int) -> str:
    """A scene with photographs."""
    scene: str = clients.call(
        "POST", "/v1/scenes", json={"name": f"scene {number}"}, headers={"Idempotency-Key": f"scene-{number}"}
    )["id"]
    send(clients, scene, photographs)
    return scene


def send(clients: Clients, scene: str, photographs: list[Path]) -> None:
    """Upload photographs."""
    for file in photographs:
        content = file.read_bytes()
        path = f"/v1/scenes/{scene}/images/sha256:{hashlib.sha256(content).hexdigest()}"
        clients.call("PUT", path, content=content)


def start(clients: Clients, scene: str, key: str) -> str:
    """Start an update."""
    job: str = clients.call(
        "POST", f"/v1/scenes/{scene}/jobs", json={"kind": "update"}, headers={"Idempotency-Key": key}
    )["id"]
    return job


def go_on(clients: Clients, jobs: dict[str, list[str]], photographs: list[Path]) -> None:
    """Add a photograph to every scene whose update has ended, and start the next one."""
    for scene, started in jobs.items():
        if len(started) > len(photographs) - 6:
            continue
        if clients.call("GET", f"/v1/jobs/{started[-1]}")["state"] in ENDED:
            send(clients, scene, [photographs[5 + len(started)]])
            started.append(start(clients, scene, f"{scene}-{len(started)}"))


def check(
    shared: dict[str, str],
    clients: Clients,
    jobs: dict[str, list[str]],
    photographs: list[Path],
    frozen: bool,
) -> None:
    """Check that no job, image or snapshot is lost or made twice."""
    with psycopg.connect(shared["FVS_DATABASE_URL"]) as database:
        for scene, started in jobs.items():
            images = clients.call("GET", f"/v1/scenes/{scene}/images")["items"]
            sent = {"sha256:" + hashlib.sha256(file.read_bytes()).hexdigest() for file in photographs}
            require({image["digest"] for image in images} <= sent, "images differ")
            require(len(images) == 5 + len(started), f"{scene} has {len(images)} images")
            for image in images:
                path = f"/v1/scenes/{scene}/images/{image['digest']}/content"
                content = clients.clients[0].get(path).content
                require("sha256:" + hashlib.sha256(content).hexdigest() == image["digest"], "bytes differ")
            for job in started:
                found = [client.get(f"/v1/jobs/{job}").json() for client in clients.clients]
                require(found[0] == found[1], f"the gateways differ: {found}")
                require(found[0]["state"] == "succeeded" and found[0]["attempt"] == 1, f"failed: {found[0]}")
                count = lambda kinds, job=job, scene=scene: database.execute(  # noqa: E731
                    _EVENTS_OF_JOB,
                    (scene, kinds, job),
                ).fetchone()[0]
                require(count(["job.succeeded", "job.failed", "job.canceled"]) == 1, f"{job} ended often")
                require(count(["snapshot.created"]) <= 2, f"{job} made more than a quick and a full model")
            question = {"generator": {"kind": "orbit", "count": 4}}
            ranking = clients.call("POST", f"/v1/scenes/{scene}/rankings", json=question)
            require(ranking["total"] == 4, f"a ranking is wrong: {ranking}")
    require(frozen, "there was no time to freeze a worker")
    with tempfile.TemporaryDirectory() as root:
        command = [*FVS, "doctor", "--root", root]
        doctor = subprocess.run(
            command, env={**os.environ, **SETTINGS, **shared}, capture_output=True, text=True, check=False
        )
    require(doctor.returncode == 0, f"the doctor finds {doctor.stdout}{doctor.stderr}")


def require(holds: bool, otherwise: str) -> None:
    """Exit unless a check holds."""
    if not holds:
        raise SystemExit(f"FAILED: {otherwise}")


if __name__ == "__main__":
    main()
