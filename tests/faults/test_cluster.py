"""The service on a real Ray cluster: each machine has a network, a folder and processes of its own."""

import os
import shutil
import signal
import time
from pathlib import Path

import pytest
from fvs_client import Client, Job, JobState
from fvs_cluster import FvsCluster
from postgresql_server import programs
from ray_cluster import RayMachine

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

_PATIENCE_S = 240.0


def _require_machines() -> None:
    """Skip where no machines can be simulated; fail instead in CI."""
    missing = []
    if os.geteuid() != 0:
        missing.append("root")
    if shutil.which("ip") is None:
        missing.append("ip: apt-get install iproute2")
    if programs() is None:
        missing.append("PostgreSQL: apt-get install postgresql")
    if missing:
        needs = f"A simulated cluster needs {', '.join(missing)}"
        (pytest.fail if os.environ.get("CI") == "true" else pytest.skip)(needs)


def _runs_at(cluster: FvsCluster) -> RayMachine | None:
    """The node with a runner."""
    return next((node for node in cluster.ray.nodes if node.processes("host.runner.process")), None)


def _until_it_trains(job: Job, cluster: FvsCluster) -> RayMachine:
    until = time.monotonic() + _PATIENCE_S
    while time.monotonic() < until:
        now = job.refresh()
        assert not now.state.ended
        node = _runs_at(cluster)
        if node is not None and now.progress > 0.1:
            return node
        time.sleep(0.1)
    raise AssertionError(f"the job does not run: {job.refresh()}")


@pytest.mark.system
@pytest.mark.process
@pytest.mark.timeout(600)
def test_a_scene_survives_the_loss_of_its_node_and_of_its_dispatcher(tmp_path: Path) -> None:
    _require_machines()
    camera = SimulatedCamera.like_a_drone(320, 240)
    write_photographs(tmp_path / "world", courtyard(), camera, orbit(6, turns=0.24), Monitor())
    with FvsCluster(tmp_path / "cluster", nodes=2, cpus=1) as cluster, Client(cluster.url) as client:
        scene = client.scenes.create("courtyard")
        scene.images.upload(tmp_path / "world" / "images")

        job = scene.update(iterations=1_500)
        lost = _until_it_trains(job, cluster)
        lost.kill()
        other = _until_it_trains(job, cluster)
        assert other is not lost

        # A dispatcher that is killed is started again, and finds the host, which has gone on.
        (runner,) = other.processes("host.runner.process")
        (dispatcher,) = cluster.workers()
        os.kill(dispatcher, signal.SIGKILL)
        ended = job.wait(timeout_s=_PATIENCE_S)
        assert ended.state is JobState.SUCCEEDED
        assert ended.attempt == 1
        assert other.processes("host.runner.process") == [runner]
        assert scene.rank().candidates
