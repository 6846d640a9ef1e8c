"""One request of a webhook: signed, to an address that was checked, without redirects and proxies."""

import asyncio
import base64
import hashlib
import hmac
import secrets
import ssl
from http import HTTPStatus

from fvs_service.webhooks.destinations import Destination, Destinations, RefusedDestinationError

_PREFIX = "whsec_"
_WITHIN_S = 15.0
"""Time for the whole request: a receiver that does its work later answers at once."""
_INTERIM = range(100, 200)


class DeliveryError(Exception):
    """The receiver has not taken the event; the message says why."""


def new_secret() -> str:
    """A new secret of a webhook."""
    return _PREFIX + base64.b64encode(secrets.token_bytes(32)).decode()


def signature(secret: str, message_id: str, timestamp: int, body: bytes) -> str:
    """The ``webhook-signature`` of Standard Webhooks."""
    key = base64.b64decode(secret.removeprefix(_PREFIX))
    signed = hmac.digest(key, f"{message_id}.{timestamp}.".encode() + body, hashlib.sha256)
    return f"v1,{base64.b64encode(signed).decode()}"


class Sender:
    """Sends events to receivers; the address that was checked is the one it connects to."""

    def __init__(self, destinations: Destinations) -> None:
        self._destinations = destinations
        self._tls = ssl.create_default_context()

    async def send(self, url: str, secret: str, message_id: str, timestamp: int, body: bytes) -> None:
        """Send one event; raises ``DeliveryError`` unless the receiver answers with 2xx."""
        try:
            async with asyncio.timeout(_WITHIN_S):
                status = await self._status(url, secret, message_id, timestamp, body)
        except TimeoutError as error:
            raise DeliveryError(f"There was no answer within {_WITHIN_S:g} s.") from error
        except RefusedDestinationError as error:
            raise DeliveryError(str(error)) from error
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise DeliveryError(f"No answer: {reason}.") from error
        if not HTTPStatus.OK <= status < HTTPStatus.MULTIPLE_CHOICES:
            raise DeliveryError(f"The answer was {status}.")

    async def _status(self, url: str, secret: str, message_id: str, timestamp: int, body: bytes) -> int:
        destination = Destination.of(url)
        address = await self._destinations.resolve(destination)
        tls = {"ssl": self._tls, "server_hostname": destination.host} if destination.secure else {}
        reader, writer = await asyncio.open_connection(address, destination.port, **tls)  # type: ignore[arg-type]
        try:
            headers = {
                "host": destination.authority,
                "content-type": "application/json",
                "content-length": str(len(body)),
                "user-agent": "fvs-webhooks",
                "webhook-id": message_id,
                "webhook-timestamp": str(timestamp),
                "webhook-signature": signature(secret, message_id, timestamp, body),
                "connection": "close",
            }
            lines = [
                f"POST {destination.target} HTTP/1.1",
                *(f"{name}: {value}" for name, value in headers.items()),
            ]
            writer.write("\r\n".join([*lines, "", ""]).encode("ascii") + body)
            await writer.drain()
            status = await _status_line(reader)
            while status in _INTERIM:
                await reader.readuntil(b"\r\n\r\n")
                status = await _status_line(reader)
            return status
        finally:
            writer.transport.abort()  # the rest of the answer is of no interest


async def _status_line(reader: asyncio.StreamReader) -> int:
    protocol, status = (await reader.readuntil(b"\r\n")).split(b" ", 2)[:2]
    if not protocol.startswith(b"HTTP/1."):
        raise ValueError("it is not HTTP/1.1")
    return int(status)
