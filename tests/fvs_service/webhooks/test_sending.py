"""One request of a webhook: to the address that was checked, with TLS for the name, and within a time."""

import asyncio
import contextlib
import socketserver
import ssl
import threading
from pathlib import Path
from typing import Any

import certificates
import pytest
from fvs_service.webhooks import sending
from fvs_service.webhooks.destinations import Destinations
from fvs_service.webhooks.sending import DeliveryError, Sender

_OK = b"HTTP/1.1 103 Early Hints\r\nlink: a\r\n\r\nHTTP/1.1 200 OK\r\n"


def _send(answer: bytes | None, host: str = "127.0.0.1", certificate: Path | None = None) -> None:
    """Send something to a server on this machine that answers with these bytes; None: never."""
    tls = None
    if certificate is not None:
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(certificate, certificate.with_suffix(".key"))

    class Handler(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            with contextlib.suppress(OSError):
                connection = tls.wrap_socket(self.request, server_side=True) if tls else self.request
                with connection:
                    received = b""
                    while not received.endswith(b"{}") and (part := connection.recv(65_536)):
                        received += part
                    connection.sendall(b"H" if answer is None else answer)
                    while answer is None and connection.recv(65_536):
                        pass

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        try:
            url = f"{'https' if tls else 'http'}://{host}:{server.server_address[1]}"
            sender = Sender(Destinations(("127.0.0.1", "hooks.example")))
            asyncio.run(sender.send(url, "whsec_AAAA", "a", 0, b"{}"))
        finally:
            server.shutdown()
            thread.join()


def _names_lead_here(monkeypatch: pytest.MonkeyPatch) -> None:
    async def getaddrinfo(_: Any, _host: str, port: int, **_options: Any) -> list[Any]:
        return [(2, 1, 6, "", ("127.0.0.1", port))]

    monkeypatch.setattr(asyncio.BaseEventLoop, "getaddrinfo", getaddrinfo)


def test_an_answer_of_2xx_is_success() -> None:
    _send(_OK)


def test_a_receiver_that_does_not_answer_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sending, "_WITHIN_S", 0.1)
    with pytest.raises(DeliveryError, match="no answer within"):
        _send(None)


def test_tls_needs_a_certificate_of_the_name_by_a_known_authority(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = certificates.made_for_tests(tmp_path)  # for 127.0.0.1
    monkeypatch.setenv("SSL_CERT_FILE", str(made["ours"]))
    _send(_OK, certificate=made["service"])
    with pytest.raises(DeliveryError, match="certificate verify failed"):
        _send(_OK, certificate=made["stranger"])
    _names_lead_here(monkeypatch)
    _send(_OK, "hooks.example")
    with pytest.raises(DeliveryError, match="certificate verify failed"):
        _send(_OK, "hooks.example", certificate=made["service"])


def test_a_name_that_leads_to_this_machine_gets_nothing(receiver: Any) -> None:
    port = receiver.url.split(":")[2].split("/")[0]

    async def send() -> None:
        sender = Sender(Destinations(("localhost",)))
        await sender.send(f"http://localhost:{port}/", "whsec_AAAA", "a", 0, b"{}")

    with pytest.raises(DeliveryError, match="not public"):
        asyncio.run(send())
    assert receiver.received == []


@pytest.mark.parametrize("answer", [b"", b"nonsense\r\n", b"HTTP/1.1 200", b"SSH-2.0-x y\r\n", b"x" * 70_000])
def test_what_is_no_answer_is_a_failure(answer: bytes) -> None:
    with pytest.raises(DeliveryError, match="No answer"):
        _send(answer)
