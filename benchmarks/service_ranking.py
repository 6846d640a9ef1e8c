"""Overhead of the service on a ranking while the same runner trains a model.

    python benchmarks/service_ranking.py [PHOTOGRAPHS] [--clients 1 8 32] [--rankings 100] [--candidates 24]
                                         [--iterations 200] [--long-side 160] [--method median-frequency]
                                         [--json ranking.json]

`fvs serve` with its defaults; the photographs (six of a simulated courtyard, if none are given) become a
scene. One client ranks while nothing else runs; then a fine model of the scene is trained, and several
clients at a time, each with its own connection, rank without a pause. No two requests are equal, which
would be computed once for both. The time of all grows with that of scoring: the default model is small. For
every request:

* scoring: the time of the engine's call, measured by the runner;
* queued: the time in the runner's queue behind other requests, which are answered one at a time;
* overhead: the rest, from the call of the client to its return (goal: p95 ≤ 10 ms with one client).

Each row is measured over REST and over gRPC, in the same run.
"""

import argparse
import itertools
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grpc
import numpy as np
from fvs.v1.views_pb2 import RankViewsRequest
from fvs.v1.views_pb2_grpc import ViewServiceStub
from fvs_client import Client, Job, Orbit, Scene, Snapshot
from fvs_service.serving.running import RunningService, running_service
from measurement import report

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

_WARM_UP = 10
_CONNECTED_S = 60.0
"""Time within which all clients must be connected, or the measurement fails."""


@dataclass(frozen=True)
class Asked:
    """One ranking, in ms."""

    request: float
    scoring: float
    queued: float

    @property
    def overhead(self) -> float:
        return self.request - self.scoring - self.queued


Rank = Callable[[int], Any]
"""Asks for a ranking with a seed, and returns it with ``seconds`` and ``waited_s``."""

SEEDS = itertools.count()


def ask(rank: Rank) -> Asked:
    seed = next(SEEDS)
    began = time.perf_counter()
    ranking = rank(seed)
    took = time.perf_counter() - began
    return Asked(1e3 * took, 1e3 * ranking.seconds, 1e3 * ranking.waited_s)


@contextmanager
def over_rest(service: RunningService, scene_id: str, options: argparse.Namespace) -> Iterator[Rank]:
    """Rank over REST, on a connection of its own."""
    with Client(service.url) as client:
        scene = client.scenes.get(scene_id)
        orbit = Orbit(count=options.candidates)
        yield lambda seed: scene.rank(generator=orbit, method=options.method, seed=seed)


@contextmanager
def over_grpc(service: RunningService, scene_id: str, options: argparse.Namespace) -> Iterator[Rank]:
    """A gRPC client that does not share its connection with other channels."""
    own = (("grpc.use_local_subchannel_pool", 1),)
    with grpc.insecure_channel(service.rpc_url.removeprefix("grpc://"), own) as channel:
        grpc.channel_ready_future(channel).result()
        stub = ViewServiceStub(channel)
        wanted = {"generator": {"orbit": {"count": options.candidates}}, "method": options.method}

        def rank(seed: int) -> Any:
            """With an idempotency key, as the client sends one over REST."""
            key, ranking = uuid.uuid4().hex, {**wanted, "seed": seed}
            return stub.RankViews(RankViewsRequest(scene_id=scene_id, ranking=ranking, idempotency_key=key))

        yield rank


TRANSPORTS = {"REST": over_rest, "gRPC": over_grpc}


def ask_together(
    service: RunningService, scene_id: str, transport: str, clients: int, options: argparse.Namespace
) -> list[Asked]:
    """The rankings of all clients, which start together."""
    ready = threading.Barrier(clients)
    each = max(1, options.rankings // clients)

    def one(_: int) -> list[Asked]:
        with TRANSPORTS[transport](service, scene_id, options) as rank:
            ready.wait(_CONNECTED_S)
            return [ask(rank) for _ in range(each)]

    with ThreadPoolExecutor(clients) as pool:
        return [asked for theirs in pool.map(one, range(clients)) for asked in theirs]


def row(
    service: RunningService,
    scene: Scene,
    transport: str,
    clients: int,
    training: Job | None,
    options: argparse.Namespace,
) -> dict[str, Any]:
    before = 0.0 if training is None else training.refresh().progress
    began = time.perf_counter()
    asked = ask_together(service, scene.id, transport, clients, options)
    took = time.perf_counter() - began
    times = {
        f"{name}, ms p50 / p95": " / ".join(
            f"{value:.1f}" for value in np.percentile([getattr(one, name) for one in asked], [50, 95])
        )
        for name in ("request", "scoring", "queued", "overhead")
    }
    return {
        "transport": transport,
        "clients": clients,
        "training": "no" if training is None else "yes",
        **{name.replace("_", " "): value for name, value in times.items()},
        "rankings": len(asked),
        "rankings/s": len(asked) / took,
        "training done, ‰/min": ""
        if training is None
        else 6e4 * (training.refresh().progress - before) / took,
    }


def wait_for_training(job: Job) -> None:
    while job.refresh().stage != "training":
        if job.state not in ("queued", "running"):
            raise SystemExit(f"The fine model's job has ended: {job.state}.")
        time.sleep(0.2)


def photographs_of_a_courtyard(folder: Path) -> Path:
    camera = SimulatedCamera.like_a_drone(320, 240)
    write_photographs(folder, courtyard(), camera, orbit(6, turns=0.24), Monitor())
    return folder / "images"


def scene_with_model(
    client: Client, photographs: Path, iterations: int = 200, long_side_px: int = 160
) -> tuple[Scene, Snapshot]:
    scene = client.scenes.create("benchmark")
    scene.images.upload(photographs)
    snapshot = scene.update(iterations=iterations, long_side_px=long_side_px).wait().snapshot()
    assert snapshot is not None
    return scene, snapshot


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("photographs", nargs="?", type=Path, help="a folder")
    parser.add_argument("--clients", type=int, nargs="+", default=[1, 8, 32])
    parser.add_argument("--rankings", type=int, default=100, help="with each number of clients, all together")
    parser.add_argument("--candidates", type=int, default=24)
    parser.add_argument("--method", default="median-frequency")
    parser.add_argument("--long-side", type=int, default=160)
    parser.add_argument("--iterations", type=int, default=200, help="of the model that ranks")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
        folder = Path(name)
        photographs = options.photographs or photographs_of_a_courtyard(folder / "courtyard")
        with (
            running_service(folder / "service", folder / "service.log") as service,
            Client(service.url) as client,
        ):
            scene, model = scene_with_model(client, photographs, options.iterations, options.long_side)
            for transport in TRANSPORTS:
                with TRANSPORTS[transport](service, scene.id, options) as rank:
                    for _ in range(_WARM_UP):
                        ask(rank)
            rows = [row(service, scene, transport, 1, None, options) for transport in TRANSPORTS]
            training = scene.fine(long_side_px=options.long_side)
            wait_for_training(training)
            rows += [
                row(service, scene, transport, clients, training, options)
                for clients in options.clients
                for transport in TRANSPORTS
            ]
            training.cancel()
    name = (
        f"ranking {options.candidates} candidates by {options.method}, "
        f"{model.metrics.gaussians:,} Gaussians, {options.long_side} px"
    )
    report(name, rows, options.json)


if __name__ == "__main__":
    main()
