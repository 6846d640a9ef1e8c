"""``Repr-Digest`` and ``Content-Digest`` (RFC 9530): both sides know that what was sent arrived whole.

The two are the same for an image that is sent whole and not encoded.
"""

import base64
import binascii
import re

from fvs_service.errors import DigestMismatchError, MalformedRequestError

_SHA256 = re.compile(r"(?:^|,)\s*sha-256=([^,]*)")
_BYTES = re.compile(r":([A-Za-z0-9+/=]*):\s*")
_EXAMPLE = "Write it as sha-256=:…:, with the digest in base64; or leave the header out."


def promised_digest(header: str | None) -> str | None:
    """The SHA-256 that a header promises, as ``sha256:…``; None when it promises none.

    Other algorithms are passed over. Raises ``MalformedRequestError`` for a SHA-256 that is none.
    """
    found = None if header is None else _SHA256.search(header)
    if found is None:
        return None
    value = _BYTES.fullmatch(found[1])
    if value is None:
        raise MalformedRequestError(f"{found[1].strip()} is no sha-256 of a digest header.", hint=_EXAMPLE)
    try:
        digest = base64.b64decode(value[1], validate=True)
    except binascii.Error as error:
        raise MalformedRequestError("The sha-256 is not base64.", hint=_EXAMPLE) from error
    if len(digest) != 32:
        raise MalformedRequestError(f"The sha-256 has {len(digest)} bytes, not 32.", hint=_EXAMPLE)
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
