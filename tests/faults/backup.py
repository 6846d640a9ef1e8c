"""Back up a running service with the documented commands, lose it, restore it, and check that all is there.

    python tests/faults/backup.py [one-machine] [many-machines]

The commands are those of ``docs/operate/maintenance.md`` (SQLite and a folder) and of
``docs/operate/many-machines.md`` (PostgreSQL and a bucket), with other paths. They need ``sqlite3``,
``rsync``, ``pg_dump``, ``pg_restore`` and ``aws``. The backup is made while a job runs. The service, its
database and its blobs are then destroyed, and restored into empty ones. There:

* every image has its bytes, and the snapshot its Gaussians;
* the job that ran goes on, and succeeds;
* a photograph that came after the backup can be sent again;
* ``fvs doctor`` finds nothing.
"""

import argparse
import contextlib
import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from abc import ABC, abstractmethod
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "servers"))

from kill_anything import QUESTION, Service, model_of, require, require_health, send, wait
from object_store_server import ACCESS_KEY_ID, SECRET_ACCESS_KEY, ObjectStoreServer
from postgresql_server import PostgresqlServer

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

PAGES = Path(__file__).resolve().parents[2] / "docs" / "operate"


class Installation(ABC):
    """A database and a blob store in ``folder``, with the commands that back them up and restore them."""

    page: str
    heading: str

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.root, self.backup = folder / "root", folder / "backup"
        self.backup.mkdir(parents=True)
        blocks = commands_below(PAGES / self.page, self.heading)
        self.back_up_commands, self.restore_commands = blocks[0], blocks[1:]

    def run(self, commands: str) -> None:
        """Run documented commands; all must succeed, but ``fvs doctor`` may report findings (status 13)."""
        for command in commands.splitlines():
            line = self.here(command)
            print(f"  $ {line}", flush=True)
            ended = subprocess.run(
                ["bash", "-c", line],
                env={**os.environ, **self.environment()},
                cwd=self.folder,
                capture_output=True,
                text=True,
                check=False,
            )
            found = line.startswith("fvs doctor") and ended.returncode == 13
            require(ended.returncode == 0 or found, f"{line}: {ended.returncode} {ended.stderr[-2000:]}")

    @abstractmethod
    def environment(self) -> dict[str, str]:
        """The settings of the service and of the commands."""

    @abstractmethod
    def here(self, command: str) -> str:
        """A documented command with the paths of this installation."""

    @abstractmethod
    def destroy(self) -> None:
        """Lose the database and the blobs; empty ones take their place."""


class OneMachine(Installation):
    """SQLite, and blobs in a folder."""

    page, heading = "maintenance.md", "Back up and restore"

    def environment(self) -> dict[str, str]:
        return {}

    def here(self, command: str) -> str:
        said = re.sub(r"\s{2,}says what.*|\s{2,}does it$", "", command)
        return said.replace("/var/lib/fvs", str(self.root)).replace("/backup", str(self.backup))

    def destroy(self) -> None:
        shutil.rmtree(self.root)
        # "Put both into an empty root."
        shutil.copytree(self.backup, self.root)


class ManyMachines(Installation):
    """PostgreSQL, and a bucket."""

    page, heading = "many-machines.md", "Backup and restore"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._number = 0
        self._start()

    def _start(self) -> None:
        self._number += 1
        self.database = PostgresqlServer(self.folder / f"postgresql-{self._number}")
        self.database.start()
        self.url = self.database.create_database("fvs")
        self.store = ObjectStoreServer(self.folder / f"store-{self._number}")
        self.store.start()
        self.store.create_bucket("fvs")

    def stop(self) -> None:
        """Stop the servers."""
        self.database.stop()
        self.store.stop()

    def environment(self) -> dict[str, str]:
        return {
            "FVS_DATABASE_URL": self.url,
            "FVS_BLOBS__URL": "s3://fvs",
            "FVS_BLOBS__ENDPOINT": self.store.endpoint,
            "FVS_BLOBS__REGION": "us-east-1",
            "FVS_BLOBS__ACCESS_KEY_ID": ACCESS_KEY_ID,
            "FVS_BLOBS__SECRET_ACCESS_KEY": SECRET_ACCESS_KEY,
            "AWS_ENDPOINT_URL": self.store.endpoint,
            "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_ACCESS_KEY_ID": ACCESS_KEY_ID,
            "AWS_SECRET_ACCESS_KEY": SECRET_ACCESS_KEY,
        }

    def here(self, command: str) -> str:
        said = command.replace("s3://bucket", "s3://fvs").replace("backup/", f"{self.backup}/")
        return said.replace("fvs doctor", f"fvs doctor --root {self.root}")

    def destroy(self) -> None:
        self.stop()
        shutil.rmtree(self.root)
        self._start()


INSTALLATIONS: dict[str, type[Installation]] = {"one-machine": OneMachine, "many-machines": ManyMachines}


def commands_below(page: Path, heading: str) -> list[str]:
    """The code blocks of a section."""
    text = page.read_text(encoding="utf-8")
    section = text.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    return re.findall(r"```text\n(.*?)```", section, flags=re.DOTALL)


def check(installation: Installation, photographs: list[Path]) -> None:
    """Back up, lose, restore, and check."""
    os.environ.update(installation.environment())
    with Service(installation.root, 1) as service:
        scene = service.call("POST", "/v1/scenes", json={"name": "kept"})["id"]
        send(service, scene, photographs[:6])
        first = wait(service, service.call("POST", f"/v1/scenes/{scene}/jobs", json={"kind": "update"})["id"])
        model = model_of(service, first)
        send(service, scene, photographs[6:8])
        second = service.call("POST", f"/v1/scenes/{scene}/jobs", json={"kind": "update"})["id"]
        while service.call("GET", f"/v1/jobs/{second}")["state"] == "queued":
            time.sleep(0.05)
        installation.run(installation.back_up_commands)
        send(service, scene, photographs[8:])
        wait(service, second)
    installation.destroy()
    os.environ.update(installation.environment())
    for commands in installation.restore_commands:
        installation.run(commands)
    with Service(installation.root, 1) as service:
        kept = {image["digest"] for image in service.call("GET", f"/v1/scenes/{scene}/images")["items"]}
        require(kept == set(map(digest_of, photographs[:8])), f"the images differ: {kept}")
        for digest in kept:
            content = service.client.get(f"/v1/scenes/{scene}/images/{digest}/content").content
            require("sha256:" + hashlib.sha256(content).hexdigest() == digest, f"{digest} has other bytes")
        require(model_of(service, first) == model, "the snapshot's Gaussians differ")
        send(service, scene, photographs[8:])
        wait(service, second)
        last = service.call("POST", f"/v1/scenes/{scene}/jobs", json={"kind": "update"})["id"]
        wait(service, last)
        ranking = service.call("POST", f"/v1/scenes/{scene}/rankings", json=QUESTION)
        require(ranking["total"] == QUESTION["generator"]["count"], f"the model does not rank: {ranking}")
        require_health(service)


def digest_of(file: Path) -> str:
    """The name of an image's bytes."""
    return "sha256:" + hashlib.sha256(file.read_bytes()).hexdigest()


def main() -> None:
    """Run the script; the exit status is 0 when all checks hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("installations", nargs="*", choices=[[], *INSTALLATIONS], metavar="INSTALLATION")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))
    for name in options.installations or INSTALLATIONS:
        with contextlib.ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fvs-backup-")))
            camera = SimulatedCamera.like_a_drone(320, 240)
            photographs = write_photographs(
                folder / "world", courtyard(), camera, orbit(9, turns=0.36), Monitor()
            )
            print(f"{name}:", flush=True)
            installation = INSTALLATIONS[name](folder / name)
            if isinstance(installation, ManyMachines):
                stack.callback(installation.stop)
            check(installation, photographs)
            print(f"{name}: all checks hold", flush=True)


if __name__ == "__main__":
    main()
