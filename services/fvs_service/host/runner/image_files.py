"""The scene's images as files for the engine: upright, 8 bits, named in the order of arrival."""

import shutil
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fvs_engine.images.catalog import catalog_images
from fvs_engine.images.normalise import normalise_images
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.stages import fresh_folder
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.images import Image
from fvs_schema.masks import MASKS
from fvs_service.images.files import ARRIVALS, READY, export_images, file_name
from fvs_service.storage.blobs import Blobs


@dataclass(frozen=True)
class PreparedImages:
    """The images of a job as files for the engine.

    ``files``: file name → image in the order of arrival; ``rejected``: digest → why the engine rejects it.
    """

    files: Mapping[str, Image]
    rejected: Mapping[str, Finding]


def prepare_images(blobs: Blobs, images: Sequence[Image], folder: Path, monitor: Monitor) -> PreparedImages:
    """Write the missing images into ``folder``.

    Files have the names that ``file_name`` gives, with another suffix where the format had to change. Images
    that were deleted meanwhile are left out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rejected: dict[str, Finding] = {}
    there = _present(folder)
    missing = [image for image in images if _stem(file_name(image)) not in there]
    if missing:
        arrivals = folder.with_name(ARRIVALS)
        shutil.rmtree(arrivals, ignore_errors=True)
        arrivals.mkdir()
        arrived = export_images(blobs, tuple(missing), arrivals)
        ready = fresh_folder(folder.with_name(READY))
        catalog = catalog_images(arrivals, monitor=monitor)
        for file in normalise_images(catalog.photographs, ready, monitor=monitor).values():
            file.replace(folder / file.name)
        rejected = {
            arrived[bad.name].digest: Finding.of(
                FindingCode.UNUSABLE_PHOTOGRAPH, [bad.name], why=bad.reason, remedy=bad.hint
            )
            for bad in catalog.rejected
        }
        shutil.rmtree(arrivals)
    present = _present(folder)
    stems = {_stem(file_name(image)): image for image in images}
    return PreparedImages(
        {present[stem]: image for stem, image in stems.items() if stem in present}, rejected
    )


def discard_images(folder: Path, kept: Collection[str]) -> None:
    """Delete the files of images that are no longer used; ``kept`` are the names of the others."""
    for name in _present(folder).values():
        if name not in kept:
            (folder / name).unlink(missing_ok=True)
            (folder.with_name(MASKS) / f"{name}.png").unlink(missing_ok=True)


def _present(folder: Path) -> dict[str, str]:
    """Stem → name of the image files in ``folder``."""
    return {_stem(file.name): file.name for file in folder.iterdir() if file.name[0].isdigit()}


def _stem(name: str) -> str:
    """The number and the beginning of the digest in a file's name."""
    return name.partition(".")[0]
