"""A network for each machine, whose cable can be pulled: namespaces of Linux, joined by a bridge."""

import os
import shutil
import subprocess
from dataclasses import dataclass

_SUBNET = "198.18"
"""Of the range that is reserved for tests of networks (RFC 2544)."""


@dataclass(frozen=True)
class Host:
    """A namespace with one address."""

    namespace: str
    address: str
    _outside: str

    def command(self, command: list[str]) -> list[str]:
        """The command line that runs ``command`` in the namespace."""
        return ["ip", "netns", "exec", self.namespace, *command]

    def processes(self) -> list[int]:
        """The ids of all processes in the namespace."""
        found = subprocess.run(
            ["ip", "netns", "pids", self.namespace], check=True, stdout=subprocess.PIPE, text=True
        )
        return [int(pid) for pid in found.stdout.split()]

    def cut(self) -> None:
        """Pull the cable: packets are lost, connections stay open."""
        _ip("link", "set", self._outside, "down")

    def join(self) -> None:
        """Put the cable back."""
        _ip("link", "set", self._outside, "up")


class Network:
    """Hosts on one bridge; ``address`` is that of this process. Needs root and the program ``ip``."""

    def __init__(self) -> None:
        if os.geteuid() != 0 or shutil.which("ip") is None:
            raise SystemExit("A network of hosts needs root, and the program ip: apt-get install iproute2")
        self._id = os.getpid()
        self._bridge = f"fvs{self._id}"
        self._prefix = f"{_SUBNET}.{self._id % 256}"
        self._hosts: list[Host] = []
        self.address = f"{self._prefix}.1"

    def __enter__(self) -> "Network":
        _ip("link", "add", self._bridge, "type", "bridge")
        _ip("address", "add", f"{self.address}/24", "dev", self._bridge)
        _ip("link", "set", self._bridge, "up")
        return self

    def __exit__(self, *_: object) -> None:
        for host in self._hosts:
            _ip("link", "delete", host._outside)  # a namespace may live on with a process that is dying
            _ip("netns", "delete", host.namespace)
        _ip("link", "delete", self._bridge)

    def host(self) -> Host:
        """A new host."""
        number = len(self._hosts) + 2
        host = Host(f"{self._bridge}-{number}", f"{self._prefix}.{number}", f"{self._bridge}.{number}")
        inside = f"{self._bridge}i{number}"
        _ip("netns", "add", host.namespace)
        self._hosts.append(host)
        _ip("link", "add", host._outside, "type", "veth", "peer", "name", inside)
        _ip("link", "set", inside, "netns", host.namespace)
        _ip("link", "set", host._outside, "master", self._bridge, "up")
        within = ("-netns", host.namespace)
        _ip(*within, "address", "add", f"{host.address}/24", "dev", inside)
        _ip(*within, "link", "set", inside, "up")
        _ip(*within, "link", "set", "lo", "up")
        return host


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True)
