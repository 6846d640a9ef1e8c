"""The headers of tus 1.0.0 (https://tus.io/protocols/resumable-upload), the protocol of resumable uploads."""

import base64
import binascii
import hashlib
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import ValidationError
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fvs_schema.images import ImageMetadata
from fvs_schema.mistakes import InvalidInput
from fvs_service.errors import (
    MalformedRequestError,
    ProtocolVersionError,
    UnsupportedMediaTypeError,
)
from fvs_service.gateway.validation import invalid_body

if TYPE_CHECKING:
    from hashlib import _Hash

PATH = "/v1/uploads"
VERSION = "1.0.0"
EXTENSIONS = "creation,creation-with-upload,expiration,checksum,termination"
ALGORITHMS = ("sha256", "sha1")
"""Checksum algorithms; the protocol requires the second."""
MEDIA_TYPE = "application/offset+octet-stream"
_OVERRIDING = ("DELETE", "HEAD", "PATCH")
_SHA256 = re.compile(r"[0-9a-f]{64}")
_NUMBER = re.compile(r"[0-9]{1,18}")
_MAX_METADATA_BYTES = 8_192
_OF_BROWSERS = frozenset(
    {"filetype", "type", "size", "lastModified", "lastModifiedDate", "relativePath", "webkitRelativePath"}
)
"""Metadata that common clients add by themselves: the properties of a browser's file, but for its name."""
_METADATA_HINT = "Write each as a name, a space, and its value in base64; separate them by commas."


@dataclass(frozen=True)
class UploadMetadata:
    """The contents of ``Upload-Metadata``."""

    scene_id: str
    digest: str
    of_image: ImageMetadata


@dataclass(frozen=True)
class Checksum:
    """The checksum that ``Upload-Checksum`` declares for the bytes of one request."""

    algorithm: str
    expected: bytes

    def hash(self) -> "_Hash":
        """A new hash of the algorithm."""
        return hashlib.new(self.algorithm, usedforsecurity=False)


class TusProtocol:
    """Add the tus version to every response to an upload, and support ``X-HTTP-Method-Override``."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or not is_upload(scope["path"]):
            await self._app(scope, receive, send)
            return
        meant = Headers(scope=scope).get("x-http-method-override", "").upper()
        if scope["method"] == "POST" and meant in _OVERRIDING:
            scope["method"] = meant

        async def send_with_version(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["Tus-Resumable"] = VERSION
                if message["status"] == ProtocolVersionError.status:
                    headers["Tus-Version"] = VERSION
            await send(message)

        await self._app(scope, receive, send_with_version)


def is_upload(path: str) -> bool:
    """Whether a path is that of a resumable upload, or of their collection."""
    return path == PATH or path.startswith(f"{PATH}/")


def require_version(headers: Headers) -> None:
    """Raise ``ProtocolVersionError`` unless the request is of this version of the protocol."""
    given = headers.get("tus-resumable")
    if given != VERSION:
        raise ProtocolVersionError(
            "The request has no Tus-Resumable header."
            if given is None
            else f"Version {given[:20]} of tus is not supported.",
            hint=f"Send Tus-Resumable: {VERSION}.",
        )


def require_upload_type(headers: Headers) -> None:
    """Raise ``UnsupportedMediaTypeError`` unless the body is a part of an upload."""
    kind = headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != MEDIA_TYPE:
        raise UnsupportedMediaTypeError(
            f"The body is {kind[:100]}." if kind else "The body has no Content-Type.",
            hint=f"Send the bytes as {MEDIA_TYPE}.",
        )


def number(headers: Headers, name: str) -> int:
    """The number of bytes in a header; raises ``MalformedRequestError``."""
    value = headers.get(name)
    if value is None:
        raise MalformedRequestError(
            f"The request has no {name} header.", hint="Send it with a number of bytes."
        )
    if not _NUMBER.fullmatch(value):
        raise MalformedRequestError(f"{name} is not a number of bytes.", hint="Send digits only.")
    return int(value)


def declared_length(headers: Headers) -> int:
    """The size of a new upload; raises ``MalformedRequestError``."""
    if "upload-defer-length" in headers:
        raise MalformedRequestError(
            "Uploads whose length is not known are not supported.", hint="Send Upload-Length."
        )
    return number(headers, "Upload-Length")


def declared_checksum(headers: Headers) -> Checksum | None:
    """The checksum of the body; None without one. Raises ``MalformedRequestError``."""
    given = headers.get("upload-checksum")
    if given is None:
        return None
    algorithm, _, encoded = given.strip().partition(" ")
    if algorithm not in ALGORITHMS:
        raise MalformedRequestError(
            f"The checksum algorithm {algorithm[:20]} is not supported.",
            hint=f"Use one of: {', '.join(ALGORITHMS)}.",
        )
    expected = _decoded(encoded)
    if expected is None or len(expected) != hashlib.new(algorithm, usedforsecurity=False).digest_size:
        raise MalformedRequestError(
            f"Upload-Checksum is not a {algorithm}.", hint="Write the name, a space, and the sum in base64."
        )
    return Checksum(algorithm, expected)


def declared_metadata(headers: Headers) -> UploadMetadata:
    """The metadata of a new upload; its ``filename``, without folders, names an image that has no name.

    Raises ``MalformedRequestError``, and ``InvalidRequestError`` for values that no image can have.
    """
    given = _pairs(headers.get("upload-metadata", ""))
    scene_id, sha256 = given.pop("scene", ""), given.pop("sha256", "")
    if not scene_id:
        raise MalformedRequestError(
            "Upload-Metadata has no scene.",
            hint="Name the scene that the image is for: scene <base64 of its id>.",
        )
    if not _SHA256.fullmatch(sha256):
        problem = "is not a SHA-256 in 64 lower-case hex digits" if sha256 else "is missing"
        raise MalformedRequestError(
            f"The sha256 in Upload-Metadata {problem}.",
            hint="Images are stored by their content: send the SHA-256 of all bytes, as sha256sum prints it.",
        )
    for name in _OF_BROWSERS:
        given.pop(name, None)
    filename = given.pop("filename", "").replace("\\", "/").rpartition("/")[2]
    try:
        of_image = ImageMetadata.model_validate(given)
    except ValidationError as error:
        raise invalid_body(
            error,
            given,
            "The fields are scene, sha256, filename and the parameters of PUT …/images/sha256:….",
        ) from None
    if of_image.name is None and filename:
        of_image = of_image.model_copy(update={"name": _name(filename)})
    return UploadMetadata(scene_id, f"sha256:{sha256}", of_image)


def _name(filename: str) -> str | None:
    """The name of a file if it can be that of an image: an invalid one must not fail an upload."""
    try:
        return ImageMetadata(name=filename).name
    except InvalidInput:
        return None


def _pairs(header: str) -> dict[str, str]:
    if len(header) > _MAX_METADATA_BYTES:
        raise MalformedRequestError(
            f"Upload-Metadata has more than {_MAX_METADATA_BYTES} bytes.", hint=_METADATA_HINT
        )
    found: dict[str, str] = {}
    for pair in header.split(",") if header.strip() else ():
        name, _, encoded = pair.strip().partition(" ")
        content = _decoded(encoded)
        try:
            value = None if content is None else content.decode()
        except UnicodeDecodeError:
            value = None
        if not name or value is None:
            raise MalformedRequestError(
                f"{name[:40] or 'A field'} in Upload-Metadata is not UTF-8 text in base64.",
                hint=_METADATA_HINT,
            )
        if name in found:
            raise MalformedRequestError(f"Upload-Metadata has {name[:40]} twice.", hint=_METADATA_HINT)
        found[name] = value
    return found


def _decoded(encoded: str) -> bytes | None:
    try:
        return base64.b64decode(encoded.strip(), validate=True)
    except (binascii.Error, ValueError):
        return None
