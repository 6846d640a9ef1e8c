"""The service on a simulated Ray cluster: rankings, a node that joins, an idle cluster, and more nodes.

    python benchmarks/cluster.py [ranking join idle throughput] [--json cluster.json]

The head and each node are in a network of their own, on this machine; needs root. Scenes are those of a
simulated courtyard, with small models.

* ``ranking``: one client ranks over REST, in turns with a runner that is a child process of `fvs serve`, and
  with one on a node; both services use the same PostgreSQL and object store. Overhead is all but scoring
  and queueing (goal of the difference: 1 ms).
* ``join``: a job is queued while the cluster has no node; then one joins. Seconds until the job runs.
* ``idle``: processor time of all processes over quiet seconds, and their memory (PSS), with a scene that is
  ready to rank.
* ``throughput``: updates of six scenes with one node and with three, all on the processor of this machine.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "servers"))

import numpy as np
from fvs_client import Client, JobState
from fvs_cluster import FvsCluster
from fvs_service.serving.process_tree import command_of, descendants
from fvs_service.serving.running import running_service
from measurement import report
from processor_time import own_s
from service_ranking import Asked, ask, photographs_of_a_courtyard, scene_with_model

_TURNS, _EACH, _WARM_UP = 5, 100, 20
_SETTLE_S, _QUIET_S = 20.0, 60.0
_SCENES, _NODES = 6, (1, 3)
_PATIENCE_S = 1800.0
_OUR_PROCESSES = {
    "serving.process gateway": "gateway",
    "serving.process worker": "dispatcher",
    "host.runner.process": "runner",
    "SceneHost": "host",
}
_RAYS_PROCESSES = {
    "gcs_server": "gcs",
    "raylet/raylet": "raylet",
    "client.server": "client server",
    "ray::": "agents",
}


def ranking(folder: Path) -> Iterator[Mapping[str, Any]]:
    """A row for each kind of runner, after turns of both."""
    photographs = photographs_of_a_courtyard(folder / "courtyard")
    with cluster_of(folder, nodes=1, cpus=2) as cluster:
        alone = {name: value for name, value in cluster.settings.items() if name != "FVS_CLUSTER"}
        alone |= {"FVS_DATABASE_URL": cluster.create_database("alone"), "FVS_BLOBS__URL": "s3://fvs/alone"}
        with (
            running_service(folder / "alone", folder / "alone.log", alone) as service,
            Client(service.url) as near,
            Client(cluster.url) as far,
        ):
            ranks = {
                name: rank_of(client, photographs)
                for name, client in (("a child process", near), ("on a node", far))
            }
            asked: dict[str, list[Asked]] = {name: [] for name in ranks}
            for rank in ranks.values():
                for _ in range(_WARM_UP):
                    ask(rank)
            for _ in range(_TURNS):
                for name, rank in ranks.items():
                    asked[name] += [ask(rank) for _ in range(_EACH)]
    for name, times in asked.items():
        yield {
            "runner": name,
            **{
                f"{part}, ms p50 / p95": " / ".join(
                    f"{value:.2f}" for value in np.percentile([getattr(one, part) for one in times], [50, 95])
                )
                for part in ("request", "scoring", "overhead")
            },
            "rankings": len(times),
        }


def rank_of(client: Client, photographs: Path) -> Callable[[int], Any]:
    scene, _ = scene_with_model(client, photographs)
    return lambda seed: scene.rank(method="median-frequency", seed=seed)


def join(folder: Path) -> Iterator[Mapping[str, Any]]:
    """A row for each of three nodes; the one before leaves first."""
    photographs = photographs_of_a_courtyard(folder / "courtyard")
    with cluster_of(folder, nodes=0, cpus=2) as cluster, Client(cluster.url) as client:
        for _ in range(3):
            scene = client.scenes.create("courtyard")
            scene.images.upload(photographs)
            job = scene.update()
            while job.refresh().waiting is None:
                time.sleep(0.05)
            time.sleep(15)  # so that the queue waits as it does for long
            waited = job.refresh().waiting
            began = time.monotonic()
            cluster.add_node()
            node = cluster.ray.nodes[-1]
            node.wait()
            up_s = time.monotonic() - began
            while job.refresh().state is not JobState.RUNNING:
                time.sleep(0.02)
            running_s = time.monotonic() - began
            while job.refresh().progress == 0:
                time.sleep(0.02)
            yield {
                "waits for": None if waited is None else waited.reason,
                "ray start, s": up_s,
                "from then to running, s": running_s - up_s,
                "to the first progress, s": time.monotonic() - began - up_s,
            }
            job.wait(timeout_s=_PATIENCE_S)
            scene.delete()
            node.kill()
            time.sleep(15)


def idle(folder: Path) -> Iterator[Mapping[str, Any]]:
    """A row for each kind of process."""
    photographs = photographs_of_a_courtyard(folder / "courtyard")
    with cluster_of(folder, nodes=3, cpus=2) as cluster, Client(cluster.url) as client:
        scene_with_model(client, photographs)
        time.sleep(_SETTLE_S)
        before, began = used_s(cluster), time.monotonic()
        time.sleep(_QUIET_S)
        took_s = time.monotonic() - began
        after, memory = used_s(cluster), memory_mb(cluster)
    for name in after:
        yield {
            "process": " ".join(name),
            "% of a core": 100 * (after[name] - before.get(name, 0.0)) / took_s,
            "PSS, MB": memory[name],
        }


def processes(cluster: FvsCluster) -> Iterator[tuple[tuple[str, str], int]]:
    """All processes, by owner (``fvs`` or the machine of Ray) and kind."""
    for served in (cluster.gateway, cluster.dispatcher):
        for pid in (served.pid, *descendants(served.pid)):
            yield ("fvs", kind_of(pid, _OUR_PROCESSES, "supervisors, inspectors")), pid
    for machine in (cluster.ray.head, *cluster.ray.nodes):
        for pid in machine.host.processes():
            ours = kind_of(pid, _OUR_PROCESSES, "")
            if ours:
                yield ("fvs", ours), pid
            else:
                place = "ray, head:" if machine is cluster.ray.head else "ray, three nodes:"
                yield (place, kind_of(pid, _RAYS_PROCESSES, "others")), pid


def kind_of(pid: int, kinds: Mapping[str, str], otherwise: str) -> str:
    command = command_of(pid)
    return next((kind for part, kind in kinds.items() if part in command), otherwise)


def used_s(cluster: FvsCluster) -> dict[tuple[str, str], float]:
    used: dict[tuple[str, str], float] = {}
    for name, pid in processes(cluster):
        used[name] = used.get(name, 0.0) + own_s(pid)
    return used


def memory_mb(cluster: FvsCluster) -> dict[tuple[str, str], float]:
    memory: dict[tuple[str, str], float] = {}
    for name, pid in processes(cluster):
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        pss_kb = next(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
        memory[name] = memory.get(name, 0.0) + pss_kb / 1024
    return memory


def throughput(folder: Path) -> Iterator[Mapping[str, Any]]:
    """A row for each number of nodes."""
    photographs = photographs_of_a_courtyard(folder / "courtyard")
    for nodes in _NODES:
        with cluster_of(folder / str(nodes), nodes, cpus=2) as cluster, Client(cluster.url) as client:
            scenes = [client.scenes.create("courtyard") for _ in range(_SCENES)]
            for scene in scenes:
                scene.images.upload(photographs)
            began = time.monotonic()
            jobs = [scene.update() for scene in scenes]
            ended = [job.wait(timeout_s=_PATIENCE_S) for job in jobs]
            took_s = time.monotonic() - began
            assert all(job.state is JobState.SUCCEEDED for job in ended)
            yield {"nodes": nodes, "scenes": _SCENES, "s": took_s, "scenes/h": 3600 * _SCENES / took_s}


@contextmanager
def cluster_of(folder: Path, nodes: int, cpus: int) -> Iterator[FvsCluster]:
    with FvsCluster(folder / "cluster", nodes, cpus) as cluster:
        yield cluster


PARTS = {"ranking": ranking, "join": join, "idle": idle, "throughput": throughput}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", default=list(PARTS), choices=list(PARTS))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    for part in options.parts:
        with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
            report(part, list(PARTS[part](Path(name))), options.json)


if __name__ == "__main__":
    main()
