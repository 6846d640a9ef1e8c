"""Podman as the engine of Compose for as long as a block lasts: without systemd, with a store of its own."""

import json
import os
import resource
import shutil
import subprocess
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

_PACKAGES = (
    "aardvark-dns",
    "buildah",
    "docker-compose",
    "iptables",
    "mmdebstrap",
    "netavark",
    "podman",
    "runc",
)
_PROJECT = "fvs-container-test"
_MOST = 16_384
"""Of files and of processes; podman 4.3 exchanges soft and hard limits, so both are one."""


class Engine:
    """Podman's store and service in ``folder``; the environment of this process leads others there."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._ended = threading.Event()
        self._health = threading.Thread(target=self._check_health)
        self._service: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        if os.geteuid() != 0:
            raise SystemExit("Containers are built and run by root here.")
        if not all(
            shutil.which(name) for name in ("buildah", "docker-compose", "mmdebstrap", "podman", "runc")
        ):
            quiet = ("-qq", "--yes", "--no-install-recommends")
            environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
            subprocess.run(["apt-get", "update", "-qq"], check=True)
            subprocess.run(["apt-get", "install", *quiet, *_PACKAGES], check=True, env=environment)
        self._folder.mkdir(parents=True, exist_ok=True)
        storage, containers = self._folder / "storage.conf", self._folder / "containers.conf"
        storage.write_text(
            f'[storage]\ndriver = "overlay"\n'
            f'graphroot = "{self._folder}/storage"\nrunroot = "{self._folder}/run"\n'
        )
        files = min(resource.getrlimit(resource.RLIMIT_NOFILE)[1], _MOST)
        processes = min(resource.getrlimit(resource.RLIMIT_NPROC)[1], _MOST)
        containers.write_text(
            f'[containers]\ndefault_ulimits = ["nofile={files}:{files}", "nproc={processes}:{processes}"]\n'
            '[engine]\nruntime = "runc"\ncgroup_manager = "cgroupfs"\nevents_logger = "file"\n'
            '[network]\nnetwork_backend = "netavark"\n'
        )
        address = f"unix://{self._folder}/podman.sock"
        os.environ |= {
            "CONTAINERS_STORAGE_CONF": str(storage),
            "CONTAINERS_CONF": str(containers),
            "DISABLE_HC_SYSTEMD": "true",
            "DOCKER_HOST": address,
        }
        # What a run left that was killed: its containers look as if they ran.
        podman("rm", "--force", "--all")
        podman("volume", "prune", "--force")
        log = (self._folder / "podman.log").open("w")
        self._service = subprocess.Popen(
            ["podman", "system", "service", "--time=0", address], stdout=log, stderr=log
        )
        self._health.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._health.join()
        if self._service is not None:
            self._service.terminate()
            self._service.wait()

    def _check_health(self) -> None:
        """What timers of systemd would do: every container's health check, every two seconds."""
        while not self._ended.wait(2.0):
            listed = subprocess.run(["podman", "ps", "--format=json"], capture_output=True, text=True)
            for container in json.loads(listed.stdout or "[]"):
                command = ["podman", "healthcheck", "run", container["Id"]]
                subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


class Deployment:
    """A compose file of the repository, started from a copy in ``folder``, which gets secrets of its own."""

    def __init__(self, repository: Path, file: str, folder: Path) -> None:
        shutil.copy(repository / "docker-compose.yml", folder)
        shutil.copytree(repository / "deploy", folder / "deploy", ignore=shutil.ignore_patterns("secrets"))
        subprocess.run(["sh", folder / "deploy" / "make_secrets.sh"], check=True)
        self._command = (
            "docker-compose",
            "--file",
            str(folder / file),
            "--project-name",
            "fvs-container-test",
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            print(self.run("ps"), self.run("logs", "--no-color", "--tail=60"), sep="\n")
        podman("rm", "--force", "--all")
        self.run("down", "--volumes")

    def run(self, *arguments: str) -> str:
        """Run a command of Compose, and return what it printed on standard output."""
        done = subprocess.run([*self._command, *arguments], stdout=subprocess.PIPE, text=True)
        if done.returncode:
            raise RuntimeError(f"{' '.join(arguments)} ended with {done.returncode}: {done.stdout[-2000:]}")
        return done.stdout

    def containers(self, service: str = "") -> list[str]:
        """The ids of the running containers of a service, or of all."""
        labels = {"project": _PROJECT} | ({"service": service} if service else {})
        filters = (f"--filter=label=com.docker.compose.{name}={value}" for name, value in labels.items())
        return podman("ps", "--quiet", *filters).split()


def podman(*arguments: str) -> str:
    """Run podman in the engine's store, and return what it printed on standard output."""
    done = subprocess.run(["podman", *arguments], stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(
            f"podman {' '.join(arguments)} ended with {done.returncode}: {done.stdout[-2000:]}"
        )
    return done.stdout
