"""Names and addresses of hosts, and which of them are this machine's own."""

import ipaddress
from urllib.parse import urlsplit


def host_of(name: str) -> str:
    """The host of ``host:port``, in lower case; "" for what is none."""
    try:
        return (urlsplit(f"//{name}").hostname or "").rstrip(".")
    except ValueError:
        return ""


def is_loopback(host: str) -> bool:
    """Whether a name or address is one that only programs on the same machine use."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
