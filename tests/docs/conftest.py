"""The services that the pages of the documentation run against."""

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest_of import conftest_of
from fvs_service.serving.running import running_service
from warm_programs import warm_programs

from fvs_schema.scenes import Alignment, AlignmentStatus

ALIGNED = Alignment(status=AlignmentStatus.ALIGNED, rms_m=0.1, inliers=6, positions=6)
_SMALL_SERVICE = {
    "FVS_WORKER__LONG_SIDE_PX": "96",
    "FVS_WORKER__INITIAL_ITERATIONS": "30",
    "FVS_WORKER__ITERATIONS_PER_IMAGE": "2",
}

_clients = conftest_of("clients")
gateway = _clients.gateway
_plain_logs = _clients._plain_logs


@pytest.fixture(scope="session")
def real_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The URL of an ``fvs serve`` that trains quickly and badly."""
    folder = tmp_path_factory.mktemp("service")
    with running_service(folder / "root", folder / "service.log", _SMALL_SERVICE) as running:
        yield running.url


@pytest.fixture(scope="session")
def programs() -> Iterator[Path]:
    """A folder with the programs that the pages name."""
    with warm_programs() as folder:
        yield folder


@pytest.fixture
def played_service(gateway: Any) -> Iterator[str]:
    """The URL of a gateway whose updates succeed at once, with a synthetic model, aligned if it can be."""
    ended = threading.Event()
    old = gateway.queued_jobs()

    def work() -> None:
        while not ended.wait(0.2):
            for job_id, scene_id in gateway.queued_jobs().items():
                if job_id not in old:
                    scene = gateway.client.get(f"/v1/scenes/{scene_id}").json()
                    placed = scene["origin"] is not None or scene["world"]["kind"] == "local"
                    gateway.model(scene_id, alignment=ALIGNED if placed else None)

    worker = threading.Thread(target=work)
    worker.start()
    yield str(gateway.client.base_url).rstrip("/")
    ended.set()
    worker.join()
