"""Names and addresses of hosts, and which of them are this machine's own."""

import contextlib
import ipaddress
import re
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


def name_or_network(name: str) -> str:
    """A host's name in lower case, or an address or network as a network; raises ``ValueError``."""
    with contextlib.suppress(ValueError):
        return str(ipaddress.ip_network(name))
    if re.fullmatch(r"[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*", name) is None:
        raise ValueError(f"{name} is neither a name nor an address nor a network, such as hooks.example")
    return name.lower()


def web_origin(name: str) -> str:
    """A web origin as browsers send it; raises ``ValueError``."""
    origin = name.rstrip("/").lower()
    if re.fullmatch(r"https?://[^/?#@*\s]+", origin) is None:
        raise ValueError(f"{name} is not an origin, such as https://console.example or http://127.0.0.1:3000")
    return origin
