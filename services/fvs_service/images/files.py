"""The files of images: their keys in the blob store, and their names for the engine.

Nothing here needs the database.
"""

import contextlib
from collections.abc import Iterable
from pathlib import Path

from fvs_engine.wording import notice
from fvs_schema.findings import Finding, Notice
from fvs_schema.images import Image, Verdict
from fvs_schema.masks import MASKS
from fvs_service.engine_errors import without_folders
from fvs_service.errors import NotFoundError
from fvs_service.storage.blob_keys import image_key, mask_key, video_key
from fvs_service.storage.blobs import Blobs

IMAGES, ARRIVALS, READY = "images", "arrivals", "ready"
"""Parts of a scene's folder on a worker: the images as the engine reads them, and two on the way there."""


def blob_key(scene_id: str, digest: str, verdict: Verdict = Verdict.ACCEPTED) -> str:
    """The blob key of an image, or of a video whose frames are not taken."""
    key = video_key if verdict is Verdict.VIDEO else image_key
    return key(scene_id, digest.removeprefix("sha256:"))


def export_images(blobs: Blobs, images: tuple[Image, ...], folder: Path) -> dict[str, Image]:
    """Write accepted images into ``folder`` for the engine; returns them by file name.

    Names sort in the order of arrival (``000017-3fa9c2d41b7e.jpg``). Existing files are kept. Images that
    were deleted meanwhile are left out. Masks go to the folder of masks in it.
    """
    named = {}
    for image in images:
        name = file_name(image)
        with contextlib.suppress(NotFoundError):
            if not (folder / name).exists():
                blobs.export(blob_key(image.scene_id, image.digest), folder / name)
                if image.mask is not None:
                    mask = mask_key(image.scene_id, image.sha256, image.mask.removeprefix("sha256:"))
                    blobs.export(mask, folder / MASKS / f"{name}.png")
            named[name] = image
    return named


def file_name(image: Image) -> str:
    """The name of an image's file for the engine."""
    suffix = {"JPEG": ".jpg", "MPO": ".jpg", "PNG": ".png", "TIFF": ".tif", "WEBP": ".webp", "BMP": ".bmp"}
    return file_stem(image.number, image.sha256) + suffix[image.format or "JPEG"]


def file_stem(number: int, sha256: str) -> str:
    """The name of an image's file without its suffix, which depends on the format."""
    return f"{number:06d}-{sha256[:12]}"


def reason_of(finding: Finding, root: Path) -> Finding:
    """What an image keeps of a finding about it: all but the engine's name of the image, and folders."""
    texts = {key: without_folders(value, root) for key, value in finding.texts.items()}
    return finding.model_copy(update={"images": (), "texts": texts})


def notice_of(finding: Finding, images: Iterable[Image], root: Path) -> Notice:
    """The finding for clients: digests and original names of images in place of the engine's file names.

    Paths in its texts, which libraries may have written, become relative to the service's ``root``.
    """
    by_stem = {file_stem(image.number, image.sha256): image for image in images}
    known = [(name, by_stem.get(name.partition(".")[0])) for name in finding.images]
    named = [name if image is None else image.name for name, image in known]
    shown = notice(reason_of(finding, root).model_copy(update={"images": tuple(named)}))
    digests = tuple(name if image is None else image.digest for name, image in known)
    return shown.model_copy(update={"images": digests})


def with_original_names(sentence: str, images: Iterable[Image]) -> str:
    """Replace file names in the message of an engine's error by the images' original names."""
    for image in images:
        name = file_name(image)
        sentence = sentence.replace(f"{name}.png", image.name).replace(name, image.name)
    return sentence
