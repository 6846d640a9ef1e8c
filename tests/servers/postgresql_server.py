"""A throw-away PostgreSQL server in a folder, run from the programs of Debian's package."""

import functools
import os
import pwd
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

_USER = "nobody"
"""The user that runs the server when the caller is root, which PostgreSQL refuses."""
_START_S = 60.0


@functools.cache
def programs() -> Path | None:
    """The folder of the newest installed server programs; None where there are none."""
    found = shutil.which("initdb")
    if found:
        return Path(found).resolve().parent
    versions = Path("/usr/lib/postgresql").glob("*/bin/initdb")  # clients alone have the folder, too
    return max((path.parent for path in versions), key=lambda folder: int(folder.parent.name), default=None)


class PostgresqlServer:
    """A server on a free port of loopback, or of ``host``; its data stay in ``folder``."""

    def __init__(self, folder: Path, host: str = "127.0.0.1") -> None:
        self._data = folder / "data"
        self._log = folder / "postgresql.log"
        self.host = host
        with socket.create_server((host, 0)) as free:
            self.port = free.getsockname()[1]
        folder.mkdir(parents=True, exist_ok=True)
        self._own(folder)
        self._run(
            "initdb", "--no-sync", "--auth=trust", "--username=fvs", "--encoding=UTF8", "-D", self._data
        )
        with (self._data / "pg_hba.conf").open("a") as access:
            access.write("host all all samenet trust\n")  # for machines with addresses of their own

    def start(self) -> None:
        """Start the server and wait until it answers."""
        assert programs() is not None
        with self._log.open("a") as log:
            self._process = subprocess.Popen(
                [
                    *_as_user(),
                    *(str(programs() / "postgres"), "-D", str(self._data), "-p", str(self.port)),
                    *("-h", self.host, "-k", "", "-c", "fsync=on", "-c", "max_connections=300"),
                ],
                stdout=log,
                stderr=log,
                cwd="/",
            )
        until = time.monotonic() + _START_S
        while self._execute("SELECT 1", "postgres").returncode != 0:
            if self._process.poll() is not None or time.monotonic() > until:
                raise RuntimeError(f"PostgreSQL does not start: {self._log.read_text()[-2000:]}")
            time.sleep(0.05)

    def stop(self) -> None:
        """Stop the server at once, as a crash does: connections are cut, and what was committed stays."""
        self._process.send_signal(signal.SIGQUIT)
        self._process.wait()

    def create_database(self, name: str) -> str:
        """The URL of a new database."""
        made = self._execute(f'CREATE DATABASE "{name}"', "postgres")
        assert made.returncode == 0, made.stderr
        return self.url(name)

    def url(self, database: str) -> str:
        """The URL of a database."""
        return f"postgresql://fvs@{self.host}:{self.port}/{database}"

    def _execute(self, statement: str, database: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [str(programs() / "psql"), "-qAt", "-c", statement, self.url(database)],
            capture_output=True,
            text=True,
            check=False,
        )

    def _run(self, program: str, *arguments: object) -> None:
        subprocess.run(
            [*_as_user(), str(programs() / program), *map(str, arguments)],
            check=True,
            stdout=subprocess.DEVNULL,
            cwd="/",
        )

    def _own(self, folder: Path) -> None:
        if os.geteuid() != 0:
            return
        shutil.chown(folder, _USER)
        for parent in folder.parents:  # temporary folders are closed to others
            if parent != Path(parent.anchor) and parent.stat().st_uid == 0:
                parent.chmod(parent.stat().st_mode | 0o011)


def _as_user() -> list[str]:
    """What runs a program as another user than root.

    ``subprocess`` could do it (``user=``), but then it calls ``fork`` instead of ``vfork``, and gRPC's fork
    handlers crash some children of a process that serves calls: 25 of 400 in a trial.
    """
    if os.geteuid() != 0:
        return []
    group = pwd.getpwnam(_USER).pw_gid
    return ["setpriv", f"--reuid={_USER}", f"--regid={group}", "--clear-groups"]
