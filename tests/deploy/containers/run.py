"""Build the images, start the compose files with Podman, and take a scene through them.

``make container-test``. It needs root on Debian 12 and the registries of Debian and PyPI, but no registry of
images: the bases, and the programs beside the service, are made of packages. ``~/.cache`` keeps the images.
"""

import argparse
import json
import re
import ssl
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from engine import Deployment, Engine, podman
from fvs_client import Client, ConnectionFailedError, Job, JobState, Orbit, Ranking, Scene, ServiceFailedError
from images import REPOSITORY, Images

_CACHE = Path.home() / ".cache" / "fvs-container-test"
_URL = "https://localhost"
_JOB_S = 900.0
_START_S = 180.0
_NET_BIND_SERVICE = 10


def main() -> None:
    """Run the tests with the arguments of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photographs", nargs="?", type=Path, help="a folder; without it, they are simulated")
    options = parser.parse_args()
    with Engine(_CACHE), tempfile.TemporaryDirectory(prefix="fvs-containers-") as folder:
        _timed("build", Images(_CACHE).build, "cpu", "ray")
        photographs = options.photographs or _simulated(Path(folder))
        _timed("one machine", _test, "docker-compose.yml", "fvs", "fvs", photographs)
        _timed("cluster", _test, "deploy/cluster/compose.yml", "gateway", "node", photographs)


def _test(file: str, gateway: str, runners: str, photographs: Path) -> None:
    """Take a scene from photographs to a ranking, and kill what trains it; stop all, and kill all."""
    with (
        tempfile.TemporaryDirectory(prefix="fvs-containers-") as folder,
        Deployment(REPOSITORY, file, Path(folder)) as deployment,
    ):
        key = deployment.run("run", "--rm", gateway, "keys", "create", "operator").split()[-1]
        deployment.run("up", "--detach")
        with _client(deployment, key, Path(folder)) as client:
            _confined(deployment)
            ranking = _ranked(client, photographs)
            job = _running_fine_job(client, ranking.scene_id)
            (training,) = [
                one for one in deployment.containers(runners) if "runner.process" in _processes(one)
            ]
            podman("kill", training)
            deployment.run("up", "--detach")
            _finished(job)
            deployment.run("stop")
            _kept_by_next_start(deployment, client, ranking)
            podman("kill", *deployment.containers())
            _kept_by_next_start(deployment, client, ranking)


def _kept_by_next_start(deployment: Deployment, client: Client, ranking: Ranking) -> None:
    """The service, started again, has the ranking, and the model for another one."""
    deployment.run("up", "--detach")
    _until_ready(client)
    assert client.rankings.get(ranking.id) == ranking
    assert _rank(client.scenes.get(ranking.scene_id)).candidates


def _confined(deployment: Deployment) -> None:
    """Users other than root without capabilities, but for the proxy's; nothing but volumes can be written."""
    for container in deployment.containers():
        (shown,) = json.loads(podman("inspect", container))
        assert shown["HostConfig"]["ReadonlyRootfs"], container
        status = podman("exec", container, "cat", "/proc/1/status")
        bounding = int(re.findall(r"^CapBnd:\s*(\w+)$", status, re.MULTILINE)[0], 16)
        assert bounding in (0, 1 << _NET_BIND_SERVICE), container
        assert bounding or not re.search(r"^Uid:\s*0", status, re.MULTILINE), container
        assert re.search(r"^NoNewPrivs:\s*1$", status, re.MULTILINE), container
        assert shown["HostConfig"]["Memory"], container


def _processes(container: str) -> str:
    return podman("top", container, "args")


def _until_ready(client: Client) -> None:
    until = time.monotonic() + _START_S
    while True:
        try:
            client.capabilities()
            return
        except (ConnectionFailedError, ServiceFailedError):
            assert time.monotonic() < until
            time.sleep(1.0)


def _client(deployment: Deployment, key: str, folder: Path) -> Client:
    """A client that trusts the proxy's own authority, which signs the certificate of ``localhost``."""
    (proxy,) = deployment.containers("proxy")
    authority = folder / "root.crt"
    source = f"{proxy}:/data/caddy/pki/authorities/local/root.crt"
    podman("cp", source, str(authority))
    return Client(_URL, key, ssl_context=ssl.create_default_context(cafile=str(authority)))


def _ranked(client: Client, photographs: Path) -> Ranking:
    """The ranking of a scene of these photographs, after an update."""
    scene = client.scenes.create("containers")
    report = scene.images.upload(photographs)
    assert report.sent
    assert not report.failed
    _finished(scene.update(iterations=400, long_side_px=480))
    return _rank(scene)


def _rank(scene: Scene) -> Ranking:
    ranking = scene.rank(generator=Orbit(), frame="model")
    assert ranking.best is not None
    return ranking


def _running_fine_job(client: Client, scene_id: str) -> Job:
    job = client.scenes.get(scene_id).fine(iterations=1_000, long_side_px=480)
    until = time.monotonic() + _JOB_S
    while job.state is not JobState.RUNNING:
        assert time.monotonic() < until, job
        time.sleep(0.5)
        job = client.jobs.get(job.id)
    return job


def _finished(job: Job) -> None:
    """Wait for the end of a job, through gateways that are restarted."""
    until = time.monotonic() + _JOB_S
    while True:
        try:
            assert job.wait(timeout_s=until - time.monotonic()).snapshot() is not None
            return
        except (ConnectionFailedError, ServiceFailedError):
            assert time.monotonic() < until
            time.sleep(1.0)


def _simulated(folder: Path) -> Path:
    fvs = Path(sys.executable).with_name("fvs")
    subprocess.run([fvs, "simulate", folder / "courtyard", "--images", "16"], check=True)
    return folder / "courtyard" / "images"


def _timed(name: str, do: Callable[..., None], *arguments: Any) -> None:
    began = time.monotonic()
    do(*arguments)
    print(f"{name}: {time.monotonic() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
