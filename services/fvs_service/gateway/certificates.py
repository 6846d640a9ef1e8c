"""The check of the files for TLS, before the servers read them: neither of them says which file is wrong."""

import contextlib
import ssl
from collections.abc import Iterator
from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_service.settings import Settings


def require_certificates(settings: Settings) -> None:
    """Load the files for TLS and mTLS; raises ``InvalidInputError`` with the variable and the file."""
    certificate, key, authority = settings.tls_certificate, settings.tls_key, settings.tls_client_ca
    if certificate is None:
        return
    assert key is not None  # the settings require both
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    with _blamed("FVS_TLS_CERTIFICATE", certificate, "It must be the certificate chain as PEM."):
        context.load_verify_locations(certificate)
    with _blamed(
        "FVS_TLS_KEY",
        key,
        f"It must be the private key of {certificate} as PEM, without a passphrase.",
    ):
        context.load_cert_chain(certificate, key, password="")  # without it OpenSSL asks on the terminal
    if authority is not None:
        with _blamed("FVS_TLS_CLIENT_CA", authority, "It must be the authority's certificate as PEM."):
            context.load_verify_locations(authority)


@contextlib.contextmanager
def _blamed(variable: str, file: Path, hint: str) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:  # an ``ssl.SSLError`` is an ``OSError``
        reason = (isinstance(error, ssl.SSLError) and error.reason) or error
        raise InvalidInputError(f"{variable}: {file} cannot be used ({reason}).", hint=hint) from error
