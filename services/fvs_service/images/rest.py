"""Images over REST."""

import contextlib
from collections.abc import AsyncIterator
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import Depends, Header, Path, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from fvs_schema.images import (
    MEDIA_TYPES,
    DigestAnswer,
    DigestCheck,
    Image,
    ImageList,
    ImageMetadata,
)
from fvs_service.application import Application
from fvs_service.errors import (
    UnsupportedMediaTypeError,
)
from fvs_service.gateway.rest.bodies import blocks, declared_bytes, json_body
from fvs_service.gateway.rest.conditions import IfNoneMatch, has, not_modified, set_tag
from fvs_service.gateway.rest.dependencies import (
    App,
    Caller,
    Counters,
    Paging,
    SceneId,
    SceneUploader,
    to_upload,
)
from fvs_service.gateway.rest.digests import declared_digest, repr_digest
from fvs_service.gateway.rest.ranges import IfRange, RangeHeader, ranged_response
from fvs_service.gateway.rest.routing import json_router
from fvs_service.images.reception import Reception
from fvs_service.images.upload_files import StagedFile, require_digest
from fvs_service.images.upload_places import UploadPlace
from fvs_service.images.uploads import Upload
from fvs_service.principal import Principal
from fvs_service.telemetry import Metrics
from fvs_service.uninterrupted import to_its_end

router = json_router("/v1/scenes/{scene_id}", "images")

Hex = Annotated[
    str, Path(pattern=r"^[0-9a-f]{64}$", description="The SHA-256 of the image's bytes.", examples=["0" * 64])
]
_SUM = "The SHA-256 of the body as `sha-256=:…:`, in base64; it must be that of the path."
_ReprDigest = Annotated[str | None, Header(alias="Repr-Digest", description=_SUM)]
_ContentDigest = Annotated[str | None, Header(alias="Content-Digest", description=_SUM)]
_BINARY: dict[str, Any] = {"schema": {"type": "string", "format": "binary"}}
_PUT: dict[str, Any] = {"requestBody": {"required": True, "content": {"application/octet-stream": _BINARY}}}
_MASK: dict[str, Any] = {"requestBody": {"required": True, "content": {"image/png": _BINARY}}}
_BYTES = {"content": dict.fromkeys(sorted({*MEDIA_TYPES.values()}), _BINARY)}
_CONTENT: dict[int | str, dict[str, Any]] = {
    200: {"description": "The whole image.", **_BYTES},
    206: {"description": "The requested range.", **_BYTES},
    304: {"description": "The image is the one that `If-None-Match` names."},
}
_THUMBNAIL: dict[int | str, dict[str, Any]] = {
    200: {"description": "The thumbnail.", "content": {"image/jpeg": _BINARY}},
    304: {"description": "The thumbnail is the one that `If-None-Match` names."},
}
_KNOWN: dict[int | str, dict[str, Any]] = {
    200: {"model": Image, "description": "The scene had the image already."}
}


@router.post("/images:check")
def check_images(
    app: App,
    caller: Caller,
    scene_id: SceneId,
    request: Annotated[DigestCheck, Depends(json_body(DigestCheck, to_upload))],
) -> DigestAnswer:
    """Check which images the scene has, so that none is sent twice, and return their verdicts."""
    return app.images.check(caller, scene_id, request)


@router.put("/images/sha256:{hexadecimal:plain}", status_code=201, responses=_KNOWN, openapi_extra=_PUT)
async def upload_image(
    app: App,
    caller: SceneUploader,
    metrics: Counters,
    scene_id: SceneId,
    hexadecimal: Hex,
    metadata: Annotated[ImageMetadata, Query()],
    request: Request,
    response: Response,
    repr_header: _ReprDigest = None,
    content_header: _ContentDigest = None,
) -> Image:
    """Send an image's bytes and return its verdict. Sending it again changes nothing.

    The body may also have the media type of an image, such as `image/jpeg`. A file whose name is that of a
    video (`.mp4`, `.mov`, `.mkv` …) is one: a job makes images from its frames.
    """
    digest = f"sha256:{hexadecimal}"
    require_digest(digest, declared_digest(repr_header), declared_digest(content_header))
    image, created = await _receive(app, caller, scene_id, digest, metadata, request, metrics)
    response.status_code = 201 if created else 200
    response.headers["Location"] = f"/v1/scenes/{scene_id}/images/{digest}"
    response.headers["Repr-Digest"] = repr_digest(digest)
    return image


@router.get("/images")
def list_images(app: App, caller: Caller, scene_id: SceneId, page: Paging) -> ImageList:
    """List the images of a scene in the order of arrival, with their verdicts."""
    return app.images.of_scene(caller, scene_id, page)


@router.get("/images/sha256:{hexadecimal:plain}")
def get_image(app: App, caller: Caller, scene_id: SceneId, hexadecimal: Hex) -> Image:
    """Return an image: its verdict, and whether it is registered."""
    return app.images.get(caller, scene_id, f"sha256:{hexadecimal}")


@router.delete("/images/sha256:{hexadecimal:plain}", status_code=204)
def delete_image(app: App, caller: Caller, scene_id: SceneId, hexadecimal: Hex) -> None:
    """Delete an image, its bytes and its duplicates; the next update makes a model without it."""
    app.exclusions.delete(caller, scene_id, f"sha256:{hexadecimal}")


@router.post("/images/sha256:{hexadecimal:plain}:exclude")
def exclude_image(app: App, caller: Caller, scene_id: SceneId, hexadecimal: Hex) -> Image:
    """Leave an image out of the next model; no effect when it is excluded already."""
    return app.exclusions.exclude(caller, scene_id, f"sha256:{hexadecimal}")


@router.post("/images/sha256:{hexadecimal:plain}:include")
def include_image(app: App, caller: Caller, scene_id: SceneId, hexadecimal: Hex) -> Image:
    """Use an excluded or quarantined image again; no effect when it is neither."""
    return app.exclusions.include(caller, scene_id, f"sha256:{hexadecimal}")


@router.put("/images/sha256:{hexadecimal:plain}/mask", openapi_extra=_MASK)
async def set_mask(
    app: App, caller: SceneUploader, scene_id: SceneId, hexadecimal: Hex, request: Request
) -> Image:
    """Give an accepted image a mask: a PNG of its size, in which black is left out.

    Sending the same mask again changes nothing. With another one the image is pending again.
    """
    _require_image_type(request)
    digest = f"sha256:{hexadecimal}"
    async with _received_whole(app, caller, request) as mask, app.inspection_turns.turn(caller):
        return await to_its_end(run_in_threadpool(app.masks.set, caller, scene_id, digest, mask))


@router.delete("/images/sha256:{hexadecimal:plain}/mask")
def remove_mask(app: App, caller: Caller, scene_id: SceneId, hexadecimal: Hex) -> Image:
    """Take the mask of an image away; no effect when it has none."""
    return app.masks.remove(caller, scene_id, f"sha256:{hexadecimal}")


@router.put(
    "/images/sha256:{hexadecimal:plain}/subtitles",
    status_code=204,
    response_class=Response,
    openapi_extra=_PUT,
)
async def set_subtitles(
    app: App, caller: SceneUploader, scene_id: SceneId, hexadecimal: Hex, request: Request
) -> None:
    """Send the subtitles (SRT) that a DJI drone recorded with a video, before the video of this digest.

    They tell where its frames were taken. Subtitles whose video does not come within a week are deleted.
    """
    digest = f"sha256:{hexadecimal}"
    async with _received_whole(app, caller, request) as file:
        await to_its_end(run_in_threadpool(app.videos.set_subtitles, caller, scene_id, digest, file))


@router.get("/images/sha256:{hexadecimal:plain}/content", response_class=Response, responses=_CONTENT)
def download_image(
    app: App,
    caller: Caller,
    scene_id: SceneId,
    hexadecimal: Hex,
    range_header: RangeHeader = None,
    if_range: IfRange = None,
    if_none_match: IfNoneMatch = None,
) -> Response:
    """Download the original of an accepted image, byte for byte as it was sent, or a range of it."""
    image = app.images.original(caller, scene_id, f"sha256:{hexadecimal}")
    return ranged_response(
        image.sha256,
        image.size_bytes,
        image.media_type,
        lambda start, stop: app.images.content(image, start, stop),
        range_header=range_header,
        if_range=if_range,
        if_none_match=if_none_match,
        headers={"Content-Disposition": _attachment(image.name)},
    )


@router.get("/images/sha256:{hexadecimal:plain}/thumbnail", response_class=Response, responses=_THUMBNAIL)
def get_thumbnail(
    app: App, caller: Caller, scene_id: SceneId, hexadecimal: Hex, if_none_match: IfNoneMatch = None
) -> Response:
    """Return an accepted image as a JPEG with a long side of at most 320 px, upright."""
    image = app.images.original(caller, scene_id, f"sha256:{hexadecimal}")
    if has(image.sha256, if_none_match):
        return not_modified(image.sha256)
    response = Response(app.images.thumbnail(image), media_type="image/jpeg")
    set_tag(response, image.sha256)
    return response


def _attachment(name: str) -> str:
    """The header that names a download (RFC 6266)."""
    plain = "".join(letter if " " <= letter <= "~" and letter not in '"\\%' else "_" for letter in name)
    return f"attachment; filename=\"{plain}\"; filename*=UTF-8''{quote(name, safe='')}"


@contextlib.asynccontextmanager
async def _received_whole(app: Application, caller: Principal, request: Request) -> AsyncIterator[StagedFile]:
    """The body of a request that cannot be continued when it breaks off."""
    with (
        app.upload_places.place(caller, request.state.pace, declared_bytes(request)) as place,
        app.uploads.receive() as receiver,
    ):
        async with place.receiving(), contextlib.aclosing(blocks(request)) as body:
            async for block in body:
                await to_its_end(run_in_threadpool(receiver.write, block))
        yield receiver.finish()


async def _receive(
    app: Application,
    caller: Principal,
    scene_id: str,
    digest: str,
    metadata: ImageMetadata,
    request: Request,
    metrics: Metrics,
) -> tuple[Image, bool]:
    """Receive the body of a PUT, and store it if the scene does not have the image."""
    _require_image_type(request)
    size = declared_bytes(request)
    with app.upload_places.place(caller, request.state.pace, size) as place:
        async with contextlib.aclosing(blocks(request)) as body:
            if size is None:
                image, created = await _received_unsized(app, caller, scene_id, digest, metadata, body, place)
                _count(metrics, image, created=created)
            else:
                upload = Upload(
                    tenant_id=caller.tenant_id,
                    scene_id=scene_id,
                    digest=digest,
                    size_bytes=size,
                    metadata=metadata,
                )
                reception = Reception(app, metrics, caller, upload)
                image, created = await reception.receive_rest(body, place)
            if not created:  # read it all, so that the connection can be reused
                async with place.receiving():
                    async for _ in body:
                        pass
    return image, created


async def _received_unsized(
    app: Application,
    caller: Principal,
    scene_id: str,
    digest: str,
    metadata: ImageMetadata,
    body: AsyncIterator[bytes],
    place: UploadPlace,
) -> tuple[Image, bool]:
    """Receive a body without a declared size; nothing of it is kept when it breaks off."""
    known = await run_in_threadpool(app.images.known, caller, scene_id, digest, metadata)
    if known is not None:
        return known, False
    with app.uploads.receive() as receiver:
        async with place.receiving():
            async for block in body:
                await to_its_end(run_in_threadpool(receiver.write, block))
        staged = receiver.finish()
        require_digest(staged.digest, digest)
        async with app.inspection_turns.turn(caller):
            return await to_its_end(run_in_threadpool(app.images.store, caller, scene_id, staged, metadata))


def _require_image_type(request: Request) -> None:
    kind = request.headers.get("content-type", "application/octet-stream").partition(";")[0].strip().lower()
    if kind != "application/octet-stream" and not kind.startswith(("image/", "video/")):
        raise UnsupportedMediaTypeError(
            f"The body is {kind}.",
            hint="Send the bytes as application/octet-stream or an image's type.",
        )


def _count(metrics: Metrics, image: Image, *, created: bool) -> None:
    if created:
        metrics.images.labels(image.verdict.value).inc()
