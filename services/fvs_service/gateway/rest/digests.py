"""``Repr-Digest`` and ``Content-Digest`` (RFC 9530): checks that all bytes arrived.

Both are the same for an image that is sent whole and without a content encoding.
"""

import base64
import binascii
import re

from fvs_service.errors import MalformedRequestError

_SHA256 = re.compile(r"(?:^|,)\s*sha-256=([^,]*)")
_BYTES = re.compile(r":([A-Za-z0-9+/=]*):\s*")
_EXAMPLE = "Write it as sha-256=:…:, with the digest in base64; or omit the header."


def declared_digest(header: str | None) -> str | None:
    """The SHA-256 in a header, as ``sha256:…``; None without one.

    Other algorithms are ignored. Raises ``MalformedRequestError`` for an invalid SHA-256.
    """
    found = None if header is None else _SHA256.search(header)
    if found is None:
        return None
    value = _BYTES.fullmatch(found[1])
    if value is None:
        raise MalformedRequestError(
            f"{found[1].strip()} is not a valid sha-256 of a digest header.", hint=_EXAMPLE
        )
    try:
        digest = base64.b64decode(value[1], validate=True)
    except binascii.Error as error:
        raise MalformedRequestError("The sha-256 is not base64.", hint=_EXAMPLE) from error
    if len(digest) != 32:
        raise MalformedRequestError(f"The sha-256 has {len(digest)} bytes, not 32.", hint=_EXAMPLE)
    return f"sha256:{digest.hex()}"


def repr_digest(digest: str) -> str:
    """The header for ``sha256:…``."""
    return f"sha-256=:{base64.b64encode(bytes.fromhex(digest.removeprefix('sha256:'))).decode()}:"
