"""Uploads that resume (tus): an image in any number of requests, over links that break."""

import re
from datetime import datetime
from email.utils import format_datetime
from http import HTTPStatus
from typing import Annotated, Any

from anyio.to_thread import run_sync
from fastapi import Depends, Path, Request, Response

from fvs_service.application import Application
from fvs_service.errors import ConflictError, InvalidRequestError, NotFoundError
from fvs_service.gateway.rest.bodies import blocks, declared_bytes, has_body
from fvs_service.gateway.rest.dependencies import App, Caller, Counters, application_of
from fvs_service.gateway.rest.routing import json_router
from fvs_service.images import rest_tus as tus
from fvs_service.images.reception import Reception
from fvs_service.images.upload_files import beyond_end
from fvs_service.images.uploads import Upload, unknown_upload
from fvs_service.principal import Principal, Scope

router = json_router(tus.PATH, "uploads")

_BINARY: dict[str, Any] = {"schema": {"type": "string", "format": "binary"}}
_BODY: dict[str, Any] = {"required": False, "content": {tus.MEDIA_TYPE: _BINARY}}
_CREATED: dict[int | str, dict[str, Any]] = {
    201: {"description": "`Location` is the upload, `Upload-Offset` where it continues."}
}
_APPENDED: dict[int | str, dict[str, Any]] = {
    204: {"description": "`Upload-Offset` is its next offset; `Content-Location` is the stored image."}
}
_STATE: dict[int | str, dict[str, Any]] = {200: {"description": "`Upload-Offset` of `Upload-Length` bytes."}}


def _header(name: str, description: str, *, required: bool = True, **schema: Any) -> dict[str, Any]:
    """A header of the protocol in the OpenAPI document; ``tus`` reads it, with the protocol's errors."""
    header = {"name": name, "in": "header", "required": required, "description": description}
    return {**header, "schema": {"type": "string", **schema}}


_VERSION = _header(
    "Tus-Resumable", f"The version of the protocol, `{tus.VERSION}`.", pattern=f"^{re.escape(tus.VERSION)}$"
)
_METADATA = _header(
    "Upload-Metadata",
    "Names and base64 values, separated by commas: `scene`, `sha256` (of all bytes, in hex), `filename`, and "
    "the parameters of `PUT …/images/sha256:…`.",
)
_LENGTH = _header("Upload-Length", "The image's size in bytes.", pattern="^[0-9]{1,18}$")
_OFFSET = _header("Upload-Offset", "Where in the image the body begins.", pattern="^[0-9]{1,18}$")
_SUM = _header(
    "Upload-Checksum",
    "`sha256` or `sha1` of the body, a space, and the sum in base64. If it is wrong (460), nothing of the "
    "body is kept.",
    required=False,
)
_CREATING: dict[str, Any] = {"requestBody": _BODY, "parameters": [_VERSION, _LENGTH, _METADATA, _SUM]}
_APPENDING: dict[str, Any] = {"requestBody": _BODY, "parameters": [_VERSION, _OFFSET, _SUM]}
_OF_VERSION: dict[str, Any] = {"parameters": [_VERSION]}


async def _upload(
    request: Request,
    caller: Caller,
    upload_id: Annotated[str, Path(description="The upload's id.", max_length=160, examples=["upl_…"])],
) -> Upload:
    """The upload of the path, to whose scene the caller may upload."""
    app = application_of(request)

    def found() -> Upload:
        tus.require_version(request.headers)  # whatever the upload is
        caller.require(Scope.UPLOAD, caller.scene_id)
        upload = app.uploads.find(caller.tenant_id, upload_id)
        try:
            app.scenes.require(caller, Scope.UPLOAD, upload.scene_id)
        except NotFoundError:  # unknown and foreign ids answer alike
            raise unknown_upload() from None
        return upload

    return await run_sync(found)


_Upload = Annotated[Upload, Depends(_upload)]


@router.options("", status_code=204, response_class=Response)
async def describe_uploads(app: App, _caller: Caller) -> Response:
    """Return the version and the extensions of tus that are supported, in headers."""
    headers = {
        "Tus-Version": tus.VERSION,
        "Tus-Extension": tus.EXTENSIONS,
        "Tus-Max-Size": str(app.storage.settings.limits.video_bytes),
        "Tus-Checksum-Algorithm": ",".join(tus.ALGORITHMS),
    }
    return Response(status_code=HTTPStatus.NO_CONTENT, headers=headers)


@router.post("", status_code=201, response_class=Response, responses=_CREATED, openapi_extra=_CREATING)
async def create_upload(
    app: App,
    caller: Caller,
    metrics: Counters,
    request: Request,
) -> Response:
    """Create an upload, or find that of the same image, which continues where it stopped.

    The body may be the beginning of the image; it is not used when bytes of it have arrived before.
    """
    tus.require_version(request.headers)
    checksum = tus.declared_checksum(request.headers)
    upload = await run_sync(_created, app, caller, request)
    reception = Reception(app, metrics, caller, upload)
    offset = await reception.offset()
    if offset == 0 and has_body(request.headers):
        offset = await _received(app, caller, request, reception, upload, 0, checksum)
    headers = await run_sync(_headers, app, upload, offset)
    return Response(
        status_code=HTTPStatus.CREATED, headers={"Location": f"{tus.PATH}/{upload.id}", **headers}
    )


@router.head("/{upload_id}", response_class=Response, responses=_STATE, openapi_extra=_OF_VERSION)
async def get_upload(app: App, caller: Caller, metrics: Counters, upload: _Upload) -> Response:
    """Return how many bytes of an upload have arrived, in headers.

    When all have, the image is stored. An upload that cannot continue, because its scene is full, is not
    found: creating it again tells why.
    """
    try:
        offset = await Reception(app, metrics, caller, upload).offset()
    except (ConflictError, InvalidRequestError):  # the response could not say what is wrong
        raise unknown_upload() from None
    headers = await run_sync(_headers, app, upload, offset)
    headers |= {
        "Upload-Length": str(upload.size_bytes),
        "Upload-Metadata": upload.declared,
        "Cache-Control": "no-store",
    }
    return Response(headers=headers)


@router.patch(
    "/{upload_id}", status_code=204, response_class=Response, responses=_APPENDED, openapi_extra=_APPENDING
)
async def append_to_upload(
    app: App,
    caller: Caller,
    metrics: Counters,
    upload: _Upload,
    request: Request,
) -> Response:
    """Send the bytes of an image from an offset on. With the last ones, the image is inspected and stored.

    What has arrived when the connection breaks is kept.
    """
    tus.require_upload_type(request.headers)
    offset = tus.number(request.headers, "Upload-Offset")
    checksum = tus.declared_checksum(request.headers)
    reception = Reception(app, metrics, caller, upload)
    offset = await _received(app, caller, request, reception, upload, offset, checksum)
    headers = await run_sync(_headers, app, upload, offset)
    return Response(status_code=HTTPStatus.NO_CONTENT, headers=headers)


@router.delete("/{upload_id}", status_code=204, openapi_extra=_OF_VERSION)
async def delete_upload(app: App, upload: _Upload) -> None:
    """Delete an upload and its bytes; an image that is stored already stays."""
    async with app.upload_locks.locked(upload.id, by_force=True):
        await run_sync(app.uploads.remove, upload)


async def _received(
    app: Application,
    caller: Principal,
    request: Request,
    reception: Reception,
    upload: Upload,
    offset: int,
    checksum: tus.Checksum | None,
) -> int:
    """Receive the body, which begins at ``offset``; returns the next offset."""
    _require_within(request, offset, upload.size_bytes)
    with app.upload_places.place(caller, request.state.pace, declared_bytes(request)) as place:
        return await reception.receive_part(blocks(request), place, offset, checksum)


def _require_within(request: Request, offset: int, size_bytes: int) -> None:
    if offset + (declared_bytes(request) or 0) > size_bytes:
        raise beyond_end(size_bytes)


def _created(app: Application, caller: Principal, request: Request) -> Upload:
    """The new upload that a request describes, on disk."""
    caller.require(Scope.UPLOAD, caller.scene_id)
    headers = request.headers
    size_bytes, metadata = tus.declared_length(headers), tus.declared_metadata(headers)
    app.scenes.require(caller, Scope.UPLOAD, metadata.scene_id)
    if has_body(headers):
        tus.require_upload_type(headers)
        _require_within(request, 0, size_bytes)
    known = app.images.known(caller, metadata.scene_id, metadata.digest, metadata.of_image)
    if known is not None and known.size_bytes != size_bytes:
        raise InvalidRequestError(
            f"The scene has this image, and it has {known.size_bytes} bytes, not {size_bytes}.",
            hint="Send the size and the SHA-256 of the same file.",
        )
    upload = Upload(
        tenant_id=caller.tenant_id,
        scene_id=metadata.scene_id,
        digest=metadata.digest,
        size_bytes=size_bytes,
        metadata=metadata.of_image,
        declared=headers.get("upload-metadata", ""),
    )
    if known is None:
        app.uploads.require_room(upload)  # before a byte is sent
    app.uploads.create(upload, finished=known is not None)
    return upload


def _headers(app: Application, upload: Upload, offset: int) -> dict[str, str]:
    """The headers of every response that tells how far an upload has come."""
    headers = {
        "Upload-Offset": str(offset),
        "Upload-Expires": _http_date(app.uploads.expires_at(upload)),
    }
    if offset == upload.size_bytes:
        headers["Content-Location"] = f"/v1/scenes/{upload.scene_id}/images/{upload.digest}"
    return headers


def _http_date(at: datetime) -> str:
    return format_datetime(at, usegmt=True)
