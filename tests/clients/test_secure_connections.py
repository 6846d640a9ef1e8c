import httpx2
from fvs_client.connection import Connection


def test_a_certificate_that_is_not_trusted_is_no_missing_service() -> None:
    connection = Connection.resolve("https://quarry.example", None, 5.0, None)
    failure = connection.failure(httpx2.ConnectError("[SSL: CERTIFICATE_VERIFY_FAILED] self-signed"))
    assert "self-signed" in failure.message
    assert "SSL_CERT_FILE" in failure.hint
    assert "fvs serve" in connection.failure(httpx2.ConnectError("refused")).hint


def test_a_connection_that_breaks_may_lack_tls() -> None:
    connection = Connection.resolve("http://quarry.example", None, 5.0, None)
    assert "https://" in connection.failure(httpx2.RemoteProtocolError("disconnected")).hint
