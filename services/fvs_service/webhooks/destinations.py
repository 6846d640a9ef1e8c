"""Where webhooks may go: to hosts of the setting, at addresses that it allows, and nowhere else."""

import asyncio
import ipaddress
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias
from urllib.parse import urlsplit

from fvs_schema.error_codes import FieldError
from fvs_service.errors import InvalidRequestError

Address: TypeAlias = ipaddress.IPv4Address | ipaddress.IPv6Address

_NAT64 = ipaddress.IPv6Network("64:ff9b::/96")


class RefusedDestinationError(Exception):
    """A request to this destination is not allowed, so none is sent."""


@dataclass(frozen=True)
class Destination:
    """The parts of a webhook's URL."""

    secure: bool
    host: str
    port: int
    authority: str
    """As the ``Host`` header has it."""
    target: str

    @classmethod
    def of(cls, url: str) -> "Destination":
        """The parts of ``url``; raises ``ValueError``."""
        parts = urlsplit(url)
        secure = parts.scheme == "https"
        if parts.username is not None or parts.fragment or not parts.hostname:
            raise ValueError("a URL with a host, without a user and a fragment")
        port = parts.port or (443 if secure else 80)
        target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        return cls(secure, parts.hostname.rstrip("."), port, parts.netloc, target)


class Destinations:
    """The hosts that webhooks may go to: names, addresses and networks.

    A name leads only to public addresses, and to those that are listed themselves: whoever controls the
    name's records cannot point it at this network.
    """

    def __init__(self, allowed: Iterable[str]) -> None:
        self._names: set[str] = set()
        self._networks: list[ipaddress.IPv4Network | ipaddress.IPv6Network] = []
        for one in allowed:
            try:
                self._networks.append(ipaddress.ip_network(one))
            except ValueError:
                self._names.add(one)

    @property
    def none(self) -> bool:
        """Whether no host is allowed: webhooks are off."""
        return not self._names and not self._networks

    def check(self, url: str) -> None:
        """Raise ``InvalidRequestError`` for a URL that no event would be sent to."""
        try:
            destination = Destination.of(url)
            self._require(destination.host)
        except (ValueError, RefusedDestinationError) as error:
            reason = str(error) if isinstance(error, RefusedDestinationError) else "It is not a URL."
            raise InvalidRequestError(
                f"url: {reason}",
                hint="The operator lists the hosts of webhooks in FVS_WEBHOOK_HOSTS.",
                errors=(FieldError("url", reason),),
            ) from error

    async def resolve(self, destination: Destination) -> str:
        """An address of the host to connect to; raises ``RefusedDestinationError``, ``OSError``."""
        self._require(destination.host)
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(destination.host, destination.port, type=socket.SOCK_STREAM)
        addresses = [str(sockaddr[0]) for *_, sockaddr in found]
        for address in addresses:
            if self._may_connect(ipaddress.ip_address(address)):
                return address
        raise RefusedDestinationError(
            f"{destination.host} has the address {addresses[0]}, which is not public, and not one of those "
            "that webhooks may go to."
        )

    def _require(self, host: str) -> None:
        address = _address(host)
        if host not in self._names and (address is None or not self._listed(address)):
            raise RefusedDestinationError(
                "Webhooks are off." if self.none else f"{host} is not a host that webhooks may go to."
            )

    def _may_connect(self, address: Address) -> bool:
        return self._listed(address) or _is_public(address)

    def _listed(self, address: Address) -> bool:
        """Whether the address is in the setting, as itself or in a network."""
        return any(one in network for one in {address, _embedded(address)} for network in self._networks)


def _address(host: str) -> Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


def _embedded(address: Address) -> Address:
    """The IPv4 address that packets to an IPv6 address reach in the end, if there is one."""
    if isinstance(address, ipaddress.IPv6Address):
        if address in _NAT64:
            return ipaddress.IPv4Address(int(address) & 0xFFFF_FFFF)
        return address.ipv4_mapped or address.sixtofour or address
    return address


def _is_public(address: Address) -> bool:
    reached = _embedded(address)
    tunnel = isinstance(reached, ipaddress.IPv6Address) and reached.teredo is not None
    return reached.is_global and not reached.is_multicast and not tunnel
