"""The scene's images as files for the engine: upright, 8 bits, named in the order of arrival."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from fvs_engine.images.catalog import catalog_images
from fvs_engine.images.normalise import normalise_images
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.stages import fresh_folder
from fvs_service.images.model import Image
from fvs_service.images.service import export_images
from fvs_service.storage.blobs import Blobs


def prepare_images(
    blobs: Blobs, images: Sequence[Image], folder: Path, monitor: Monitor
) -> Mapping[str, Image]:
    """Write the missing images into ``folder``; returns file name → image in the order of arrival.

    Files have the names that ``file_name`` gives, with another suffix where the format had to change. Images
    that the engine cannot use are left out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    missing = [image for image in images if image.number not in _present(folder)]
    if missing:
        arrivals = folder.with_name("arrivals")
        shutil.rmtree(arrivals, ignore_errors=True)
        export_images(blobs, tuple(missing), arrivals)
        ready = fresh_folder(folder.with_name("ready"))
        photographs = catalog_images(arrivals, monitor=monitor).photographs
        for file in normalise_images(photographs, ready, monitor=monitor).values():
            file.replace(folder / file.name)
        shutil.rmtree(arrivals)
    present = _present(folder)
    return {present[image.number]: image for image in images if image.number in present}


def _present(folder: Path) -> dict[int, str]:
    return {int(file.name.split("-")[0]): file.name for file in folder.iterdir() if file.name[0].isdigit()}
