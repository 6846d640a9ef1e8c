"""Debian's Caddy with the configuration of ``deploy/proxy``, in front of gateways on loopback."""

import os
import shutil
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

CONFIGURATION = Path(__file__).resolve().parents[2] / "deploy" / "proxy" / "Caddyfile"
_START_S = 30.0


def caddy() -> str | None:
    """Where Caddy is; None when it is not installed."""
    return shutil.which("caddy")


@dataclass(frozen=True)
class Proxy:
    """A proxy at ``url``, which leads to REST and gRPC; ``authority`` has signed its certificate."""

    url: str
    authority: Path
    log: Path

    @property
    def port(self) -> int:
        """Of HTTPS."""
        return int(self.url.rpartition(":")[2])


@contextmanager
def running_proxy(
    folder: Path,
    rest_url: str,
    rpc_url: str | None = None,
    *,
    names: Sequence[str] = ("localhost",),
    client_authority: Path | None = None,
) -> Iterator[Proxy]:
    """A proxy of these ``names`` for as long as the block lasts, with a certificate by its own authority.

    With ``client_authority`` clients need a certificate by that. Its log is in ``folder``.
    """
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(2)]
        port, plain = (one.getsockname()[1] for one in sockets)
    given = {
        "PROXY_HOST": ", ".join(names),
        "PROXY_TLS": "internal",
        "PROXY_HTTPS_PORT": str(port),
        "PROXY_HTTP_PORT": str(plain),
        "PROXY_REST": _upstream(rest_url),
        "PROXY_GRPC": _upstream(rpc_url or rest_url),
        "XDG_DATA_HOME": str(folder / "data"),
        "XDG_CONFIG_HOME": str(folder / "config"),
    }
    if client_authority is not None:
        given |= {"PROXY_CLIENTS": "certified", "PROXY_CLIENT_CA": str(client_authority)}
    folder.mkdir(parents=True, exist_ok=True)
    program = caddy()
    assert program is not None
    with (
        (folder / "log").open("w") as log,
        subprocess.Popen(
            [program, "run", "--config", str(CONFIGURATION), "--adapter", "caddyfile"],
            stdout=log,
            stderr=log,
            env={**os.environ, **given},
        ) as process,
    ):
        try:
            until = time.monotonic() + _START_S
            while not all(_is_secured(port, name) for name in names):
                if process.poll() is not None or time.monotonic() > until:
                    raise RuntimeError(f"Caddy does not start: {(folder / 'log').read_text()[-2000:]}")
                time.sleep(0.05)
            authority = folder / "data" / "caddy" / "pki" / "authorities" / "local" / "root.crt"
            yield Proxy(f"https://{names[0]}:{port}", authority, folder / "log")
        finally:
            process.terminate()


def _upstream(url: str) -> str:
    """As ``PROXY_REST`` has it."""
    parts = urlsplit(url)
    return f"{parts.hostname} {parts.port}"


def _is_secured(port: int, name: str) -> bool:
    """Whether the proxy has a certificate for ``name``, which it makes once it listens."""
    try:
        with (
            socket.create_connection(("127.0.0.1", port), 5) as connection,
            ssl._create_unverified_context().wrap_socket(connection, server_hostname=name),
        ):
            return True
    except OSError:
        return False
