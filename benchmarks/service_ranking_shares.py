"""Which share of a ranking's overhead is what, over REST and over gRPC.

    python benchmarks/service_ranking_shares.py [--rankings 200] [--candidates 24] [--json shares.json]

`fvs serve` makes a small model of a simulated courtyard. A second gateway on its data, in whose functions the
time is taken, answers one client that ranks without a pause, over REST and gRPC in turns. For each share of
the overhead: its time by the clock, and the processor time of the gateway; the medians of all rankings. The
runner's scoring and the queue before it are no overhead, and are left out.
"""

import argparse
import multiprocessing
import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import wraps
from inspect import iscoroutinefunction
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from typing import Any

from fvs_client import Client
from fvs_service.gateway.addresses import Addresses
from fvs_service.gateway.rest import bodies
from fvs_service.gateway.rest.middleware import RequestContext
from fvs_service.gateway.rpc import operations
from fvs_service.host.worker.runners import LeasedRunners
from fvs_service.logs import configure_logging
from fvs_service.rankings import rpc as views
from fvs_service.rankings.service import Rankings
from fvs_service.serving.gateway import run_gateway
from fvs_service.serving.running import RunningService, running_service
from fvs_service.settings import Settings
from fvs_service.storage.database import Database
from measurement import report
from service_ranking import TRANSPORTS, Rank, photographs_of_a_courtyard, scene_with_model

from fvs_schema.rankings import Ranking

_WARM_UP = 20
_PATIENCE_S = 60.0

CLIENT = "client, and the connection to it"
TRANSPORT = "HTTP or gRPC, dependencies, changes of threads, log"
REQUEST = "request: parsing, validation"
READ = "database: scene, permission, lease"
POSES_IN = "poses: candidates, into the model frame"
RUNNER = "to the runner and back"
POSES_OUT = "poses: ranking, into the frame of the answer"
WRITE = "database: ranking and event, committed"
RESPONSE = "response: JSON or protobuf"
ALL = "all"
SHARES = (CLIENT, TRANSPORT, REQUEST, READ, POSES_IN, RUNNER, POSES_OUT, WRITE, RESPONSE, ALL)

_FUNCTIONS: tuple[tuple[Any, str, str], ...] = (
    (RequestContext, "__call__", TRANSPORT),
    (operations, "answer", TRANSPORT),
    (bodies, "parse", REQUEST),
    (operations, "parsed", REQUEST),
    (views, "read", REQUEST),
    (Database, "querying", READ),
    (Rankings, "_prepare", POSES_IN),
    (LeasedRunners, "rank", RUNNER),
    (Rankings, "_finish", POSES_OUT),
    (Database, "writing", WRITE),
    (Ranking, "model_dump_json", RESPONSE),
    (operations, "write", RESPONSE),
)
"""Where the time is taken. What a function spends in another one of them counts for that one alone."""


@dataclass
class _Block:
    """A timed block; ``inside`` is the time of the blocks nested in it.

    ``times`` are those of its request: by the clock and of the processor, of each share.
    """

    times: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(lambda: [0.0, 0.0]))
    inside_s: float = 0.0
    inside_cpu_s: float = 0.0


class Stopwatch:
    """Takes the times of the functions, and calls back with those of a request at its end.

    Requests come one after the other. Coroutines have no processor time of their own: theirs is what the
    shares leave of the process's.
    """

    def __init__(self, at_end: Callable[[dict[str, tuple[float, float]]], object]) -> None:
        self._at_end = at_end
        self._block: ContextVar[_Block | None] = ContextVar("block", default=None)
        self._process_s = time.process_time()
        for owner, name, share in _FUNCTIONS:
            self._wrap(owner, name, share)

    def _wrap(self, owner: Any, name: str, share: str) -> None:
        function = getattr(owner, name)
        if owner is Database:

            @contextmanager
            def timed(*arguments: Any, **options: Any) -> Iterator[Any]:
                with self._timed(share), function(*arguments, **options) as session:
                    yield session

        elif iscoroutinefunction(function):

            @wraps(function)
            async def timed(*arguments: Any) -> Any:
                with self._timed(share, coroutine=True) as block:
                    result = await function(*arguments)
                    if function.__name__ == "rank":
                        block.inside_s += result.seconds + result.waited_s
                    return result

        else:

            @wraps(function)
            def timed(*arguments: Any) -> Any:
                with self._timed(share):
                    return function(*arguments)

        setattr(owner, name, timed)

    @contextmanager
    def _timed(self, share: str, *, coroutine: bool = False) -> Iterator[_Block]:
        # What is open where a request begins is of an earlier one over the same connection.
        outer = None if share == TRANSPORT else self._block.get()
        block = _Block() if outer is None else _Block(outer.times)
        token = self._block.set(block)
        began, began_cpu = time.perf_counter(), time.thread_time()
        try:
            yield block
        finally:
            self._block.reset(token)
            took = time.perf_counter() - began
            took_cpu = block.inside_cpu_s if coroutine else time.thread_time() - began_cpu
            block.times[share][0] += took - block.inside_s
            block.times[share][1] += took_cpu - block.inside_cpu_s
            if outer is not None:
                outer.inside_s += took
                outer.inside_cpu_s += took_cpu
            elif share == TRANSPORT:  # others are not those of a request
                self._end(block.times)

    def _end(self, times: dict[str, list[float]]) -> None:
        now = time.process_time()
        times[TRANSPORT][1] = now - self._process_s - sum(cpu for _, cpu in times.values())
        self._at_end({share: (seconds, cpu) for share, (seconds, cpu) in times.items()})
        self._process_s = time.process_time()


def _gateway(root: Path, to: Connection) -> None:
    """A gateway that sends its addresses, and after each request the times of its shares."""
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 2)  # for its log
    configure_logging(machine=False)
    Stopwatch(to.send)
    run_gateway(Settings(root=root, port=0), LeasedRunners, announce=to.send)


@contextmanager
def gateway_on(root: Path) -> Iterator[tuple[RunningService, Connection]]:
    """A gateway whose times are taken, on the data of a running service."""
    spawned = multiprocessing.get_context("spawn")
    here, there = spawned.Pipe()
    process = spawned.Process(target=_gateway, args=(root, there))
    process.start()
    try:
        addresses: Addresses = here.recv()
        url = addresses.url
        host = url.partition("//")[2].rpartition(":")[0]
        yield RunningService(url, f"grpc://{host}:{addresses.rpc_port}", process.pid or 0), here
    finally:
        process.terminate()
        process.join()


@dataclass
class Measured:
    """The times of one transport: of each share, by the clock and of the processor."""

    rank: Rank
    times: defaultdict[str, list[tuple[float, float]]]

    def medians_ms(self, share: str) -> tuple[float, float]:
        pairs = self.times.get(share, [(0.0, 0.0)])
        return 1e3 * median(wall for wall, _ in pairs), 1e3 * median(cpu for _, cpu in pairs)


def measure_in_turns(
    service: RunningService, times: Connection, scene_id: str, options: argparse.Namespace
) -> dict[str, Measured]:
    """Rank over each transport in turns, so that other programs disturb all of them alike."""
    with ExitStack() as stack:
        measured = {
            name: Measured(stack.enter_context(connected(service, scene_id, options)), defaultdict(list))
            for name, connected in TRANSPORTS.items()
        }
        while times.poll(0.5):  # those of what the clients have asked so far
            times.recv()
        for number in range(_WARM_UP + options.rankings):
            for one in measured.values():
                began, began_cpu = time.perf_counter(), time.process_time()
                ranking = one.rank(number)
                took, took_cpu = time.perf_counter() - began, time.process_time() - began_cpu
                if not times.poll(_PATIENCE_S):
                    raise SystemExit("The gateway has sent no times.")
                shares: dict[str, tuple[float, float]] = times.recv()
                inside = sum(seconds for seconds, _ in shares.values())
                shares[CLIENT] = took - ranking.seconds - ranking.waited_s - inside, took_cpu
                shares[ALL] = (
                    took - ranking.seconds - ranking.waited_s,
                    sum(cpu for _, cpu in shares.values()),
                )
                if number >= _WARM_UP:
                    for share, pair in shares.items():
                        one.times[share].append(pair)
        return measured


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rankings", type=int, default=200)
    parser.add_argument("--candidates", type=int, default=24)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    options.method = "median-frequency"

    with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
        folder = Path(name)
        with (
            running_service(folder / "service", folder / "log") as service,
            Client(service.url) as client,
        ):
            scene, _ = scene_with_model(client, photographs_of_a_courtyard(folder / "courtyard"))
            with gateway_on(folder / "service") as (measured, times):
                found = measure_in_turns(measured, times, scene.id, options)
    rows = [
        {
            "share": share,
            **{
                f"{transport}, {what}": milliseconds
                for transport, one in found.items()
                for what, milliseconds in zip(("clock", "processor"), one.medians_ms(share), strict=True)
            },
        }
        for share in SHARES
    ]
    report(f"overhead of ranking {options.candidates} candidates, ms", rows, options.json)


if __name__ == "__main__":
    main()
