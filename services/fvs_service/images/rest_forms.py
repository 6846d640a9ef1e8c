"""Images and their masks as a form, for browsers and curl."""

from collections.abc import AsyncIterator
from typing import Any

from fastapi import Request
from starlette.concurrency import run_in_threadpool

from fvs_schema.images import ImageMetadata, RefusedMask, UploadAnswer, UploadItem
from fvs_schema.masks import mask_names
from fvs_schema.mistakes import InvalidInput
from fvs_service.errors import ConflictError, InvalidRequestError, NotFoundError
from fvs_service.gateway.rest.bodies import declared_bytes
from fvs_service.gateway.rest.dependencies import App, Counters, Parsing, SceneId, SceneUploader
from fvs_service.gateway.rest.multipart import UploadedFile, receive_files
from fvs_service.gateway.rest.routing import json_router
from fvs_service.images.masks import Masks
from fvs_service.images.upload_places import UploadPlace
from fvs_service.principal import Principal
from fvs_service.uninterrupted import to_its_end

router = json_router("/v1/scenes/{scene_id}", "images")

_MOST_FILES = 200
"""Maximum number of files in a form."""
_BINARY: dict[str, Any] = {"type": "string", "format": "binary"}
_FORM: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "properties": {
                        "file": {
                            "type": "array",
                            "minItems": 1,
                            "items": _BINARY,
                            "description": "The images, one or more.",
                        },
                        "mask": {
                            "type": "array",
                            "items": _BINARY,
                            "description": "Masks of images of the form, by name: that of `a.jpg` is "
                            "`a.png` or `a.jpg.png`, a PNG of its size in which black is left out. A file "
                            "whose name has a folder `masks` is one, too.",
                        },
                    },
                    "required": ["file"],
                    "additionalProperties": False,
                }
            }
        },
    }
}


@router.post("/images", openapi_extra=_FORM)
async def upload_images(
    app: App, caller: SceneUploader, metrics: Counters, parsing: Parsing, scene_id: SceneId, request: Request
) -> UploadAnswer:
    """Send images and their masks as a form.

    Images that have fully arrived when the connection breaks are kept. Masks are set after all images; one
    that is refused costs no image.
    """
    await run_in_threadpool(app.images.require_open, caller, scene_id)
    items: list[UploadItem] = []
    masks = _Masks(app.masks, caller, scene_id, items)
    with app.upload_places.place(caller, request.state.pace, declared_bytes(request)) as place:
        files = receive_files(request, app.uploads, _MOST_FILES, parsing)
        while (file := await _next(files, place)) is not None:
            async with app.inspection_turns.turn(caller):
                if file.is_mask:
                    await to_its_end(run_in_threadpool(masks.set, file))
                    continue
                image, new = await run_in_threadpool(
                    app.images.store, caller, scene_id, file.staged, _named(file.name)
                )
            if new:
                metrics.images.labels(image.verdict.value).inc()
            items.append(UploadItem(name=file.name, created=new, image=image))
    if not items:
        raise InvalidRequestError(
            "The form has no image.", hint="Send one, as in curl -F file=@photograph.jpg."
        )
    return UploadAnswer(items=tuple(items), refused_masks=tuple(masks.refused))


class _Masks:
    """Gives the masks of a form to its images ``items``, by the names of the files without folders."""

    def __init__(self, masks: Masks, caller: Principal, scene_id: str, items: list[UploadItem]) -> None:
        self._masks, self._caller, self._scene_id, self._items = masks, caller, scene_id, items
        self._masked: set[str] = set()
        self.refused: list[RefusedMask] = []

    def set(self, file: UploadedFile) -> None:
        """Give a mask to its image, which has it then in ``items``, or refuse it."""
        try:
            self._set(file)
        except (InvalidRequestError, ConflictError, NotFoundError) as error:
            self.refused.append(RefusedMask(name=file.name, reason=error.message, hint=error.hint))

    def _set(self, file: UploadedFile) -> None:
        digest = self._image_of(file)
        masked = self._masks.set(self._caller, self._scene_id, digest, file.staged)
        self._masked.add(digest)
        for index, item in enumerate(self._items):
            if item.image.digest == digest:
                self._items[index] = item.model_copy(update={"image": masked})

    def _image_of(self, file: UploadedFile) -> str:
        """The digest of the one image whose mask it is by name; raises when there is none, or another."""
        mask = _base_name(file.name)
        names = {_base_name(item.name) for item in self._items}
        owners = {
            item.image.digest: item.name
            for item in self._items
            if mask in mask_names(_base_name(item.name), names.__contains__)
        }
        if not owners:
            raise NotFoundError(
                "It is the mask of no image in the form.",
                hint="The mask of a.jpg is a.png or a.jpg.png. Send it with its image.",
            )
        if len(owners) > 1:
            raise ConflictError(
                f"It could be the mask of {' or '.join(owners.values())}.",
                hint="Send them in different forms, or the mask as a.jpg.png.",
            )
        (digest,) = owners
        if digest in self._masked:
            raise ConflictError(
                f"{owners[digest]} has another mask in the form.", hint="Send one mask of each image."
            )
        return digest


def _base_name(filename: str) -> str:
    """The name of a file without folders, which some browsers send (RFC 7578, section 4.2)."""
    return filename.replace("\\", "/").rpartition("/")[2]


async def _next(files: AsyncIterator[UploadedFile], place: UploadPlace) -> UploadedFile | None:
    """The next file of a form; None after the last."""
    async with place.receiving():
        return await anext(files, None)


def _named(filename: str) -> ImageMetadata:
    """The name of an image; an invalid one must not fail the form: it is then named by its digest."""
    try:
        return ImageMetadata(name=_base_name(filename))
    except InvalidInput:
        return ImageMetadata()
