"""``Repr-Digest`` (RFC 9530): the digest of what is sent, so that both sides know that it arrived whole."""

import base64
import binascii
import re

from fvs_service.errors import DigestMismatchError, MalformedRequestError

_SHA256 = re.compile(r"(?:^|,)\s*sha-256=:([A-Za-z0-9+/=]*):\s*(?:$|,)")


def promised_digest(header: str | None) -> str | None:
    """The SHA-256 that a ``Repr-Digest`` header promises, as ``sha256:…``; None when it promises none."""
    if header is None:
        return None
    found = _SHA256.search(header)
    if found is None:
        return None
    try:
        digest = base64.b64decode(found[1], validate=True)
    except binascii.Error as error:
        raise MalformedRequestError("The sha-256 of Repr-Digest is not base64.") from error
    if len(digest) != 32:
        raise MalformedRequestError("The sha-256 of Repr-Digest has not 32 bytes.")
    return f"sha256:{digest.hex()}"


def repr_digest(digest: str) -> str:
    """The header that says what ``sha256:…`` says."""
    return f"sha-256=:{base64.b64encode(bytes.fromhex(digest.removeprefix('sha256:'))).decode()}:"


def require_digest(actual: str, *promised: str | None) -> None:
    """Raise ``DigestMismatchError`` unless every promise was kept."""
    for digest in promised:
        if digest is not None and digest != actual:
            raise DigestMismatchError(
                f"The bytes have the digest {actual}, not {digest}.", hint="Send the image again."
            )
