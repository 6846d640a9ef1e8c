"""Delay of a scene by clients that request rankings and hang up.

    python benchmarks/service_abandoned.py [--clients 40] [--candidates 500] [--hang-up 1] [--same]

`fvs serve` with its defaults and a model of a simulated courtyard. All clients send a request at
once, each on its own connection, and hang up. Then an honest client ranks 24 candidates, and repeats its
request whenever the service tells it to. Its time is compared with that of the same request before.
"""

import argparse
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import httpx2
from fvs_client import NO_RETRIES, Client, Orbit, Scene
from fvs_client.errors import ApiError, FvsError
from fvs_service.serving.running import running_service
from measurement import report
from service_ranking import photographs_of_a_courtyard

_HONEST_CANDIDATES = 24
_GIVE_UP_S = 900.0


def honest_answer_s(scene: Scene) -> float:
    """The time until a client that follows the service's instructions has its ranking."""
    began = time.monotonic()
    while time.monotonic() - began < _GIVE_UP_S:
        try:
            scene.rank(generator=Orbit(count=_HONEST_CANDIDATES))
        except ApiError as error:
            time.sleep(error.retry_after_s or 1.0)
        except FvsError:  # no answer in time: at once again, as a client with retries
            continue
        else:
            break
    return time.monotonic() - began


def abandon(url: str, scene_id: str, options: argparse.Namespace) -> dict[str, int]:
    """All clients send a request and hang up; returns the number of clients by status."""
    outcomes: dict[str, int] = {}
    ready = threading.Barrier(options.clients)

    def one(number: int) -> None:
        generator = {"kind": "orbit", "count": options.candidates}
        document = {"generator": generator, "seed": 0 if options.same else number}
        with httpx2.Client(base_url=url, timeout=options.hang_up) as client:
            ready.wait()
            try:
                answer = client.post(f"/v1/scenes/{scene_id}/rankings", json=document)
                outcome = str(answer.status_code)
            except httpx2.TimeoutException:
                outcome = "hung up"
        outcomes[outcome] = outcomes.get(outcome, 0) + 1

    threads = [threading.Thread(target=one, args=(number,)) for number in range(options.clients)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return outcomes


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--clients", type=int, default=40)
    parser.add_argument("--candidates", type=int, default=500)
    parser.add_argument("--hang-up", type=float, default=1.0, metavar="S")
    parser.add_argument("--same", action="store_true", help="all send the same request")
    parser.add_argument("--iterations", type=int, default=300, help="of the model that ranks")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
        folder = Path(name)
        photographs = photographs_of_a_courtyard(folder / "courtyard")
        with (
            running_service(folder / "service", folder / "service.log") as service,
            Client(service.url, retries=NO_RETRIES) as client,
        ):
            scene = client.scenes.create("benchmark")
            scene.images.upload(photographs)
            scene.update(iterations=options.iterations).wait()
            honest_answer_s(scene)  # loads the model
            before = honest_answer_s(scene)
            outcomes = abandon(service.url, scene.id, options)
            after = honest_answer_s(scene)
    row: dict[str, Any] = {
        "clients": options.clients,
        "candidates": options.candidates,
        "requests": "the same" if options.same else "each its own",
        "answers to them": ", ".join(f"{count} {outcome}" for outcome, count in sorted(outcomes.items())),
        "honest answer before, s": before,
        "honest answer after, s": after,
    }
    report("rankings without a waiting client", [row], options.json)


if __name__ == "__main__":
    main()
