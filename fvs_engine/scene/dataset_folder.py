"""Search for a dataset's photographs and poses in a folder."""

from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.folders import require_folder
from fvs_engine.scene.dataset import Dataset, read_dataset
from fvs_engine.sfm.colmap.model import has_colmap_model

_MODELS = ("reference", "sparse/0", "sparse", "0", ".")
"""Subfolders in which published datasets have their COLMAP model."""


def open_dataset(folder: Path, colmap: Path | None = None, transforms: Path | None = None) -> Dataset:
    """The dataset in ``folder``: photographs in it or in its ``images``, poses as named or found there.

    Poses are those of the COLMAP model ``colmap`` or of the file ``transforms``; without either those of
    ``transforms.json``, else of a COLMAP model in ``reference``, ``sparse/0``, ``sparse`` or the folder
    itself. Raises ``InvalidInputError`` when there are none, and what ``read_dataset`` raises.
    """
    require_folder(folder, "Give the folder of the dataset.")
    images = folder / "images" if (folder / "images").is_dir() else folder
    if colmap is not None and transforms is not None:
        raise InvalidInputError(
            "Poses can come from one source only.", hint="Give either --colmap or --transforms."
        )
    if colmap is None and transforms is None:
        if (folder / "transforms.json").is_file():
            transforms = folder / "transforms.json"
        else:
            models = (folder / name for name in _MODELS)
            colmap = next((model for model in models if has_colmap_model(model)), None)
    if colmap is None and transforms is None:
        raise InvalidInputError(
            f"{folder} holds no poses: neither transforms.json nor a COLMAP model.",
            hint="Name them with --colmap DIR or --transforms FILE; `fvs reconstruct` makes a COLMAP model.",
        )
    return read_dataset(images, colmap, transforms)
