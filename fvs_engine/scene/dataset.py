"""A dataset: photographs with known poses, in the dataset's own frame."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray
from PIL import ExifTags, Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.folders import require_folder
from fvs_engine.geometry import Camera
from fvs_engine.images.catalog import SUFFIXES
from fvs_engine.images.names import is_mask, match_files
from fvs_engine.scene.sparse_points import SparsePoints, points_from_pycolmap
from fvs_engine.sfm.colmap.imports import find_colmap_model, fit_camera, import_transforms_json
from fvs_engine.sfm.colmap.model import (
    camera_from_pycolmap,
    has_colmap_model,
    open_colmap,
    rigid_from_pycolmap,
)
from fvs_engine.views import AnyView, View
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.names import readable_name

_MIN_VIEWS = 2


@dataclass(frozen=True, eq=False)
class Dataset:
    """Photographs in ``image_dir`` with their poses; ``views`` are in order of capture, which is by name.

    A view's name is its photograph's posix path in ``image_dir``, its camera has the photograph's size, and
    its ``camera_from_model`` starts from the dataset's own model: a scene with known poses takes that as its
    model frame, a scene that estimates poses aligns with it. ``points`` are those of the dataset's model,
    None when it has none. ``warnings`` are about what was left out. ``arriving``: photographs are added to
    the folder over time, may be deleted from it, and have no known poses; there are no views then, and a
    scene of it estimates poses by structure from motion.
    """

    name: str
    image_dir: Path
    views: tuple[AnyView, ...]
    points: SparsePoints | None = None
    warnings: tuple[Finding, ...] = field(default=())
    arriving: bool = False

    @cached_property
    def by_name(self) -> dict[str, AnyView]:
        """Name → view."""
        return {view.name: view for view in self.views}

    @property
    def names(self) -> tuple[str, ...]:
        """The views' names, in order of capture."""
        return tuple(view.name for view in self.views)

    def centres(self) -> dict[str, NDArray[np.float64]]:
        """Name → camera centre [3] in the dataset's model frame."""
        return {view.name: view.centre for view in self.views}


def read_dataset(images: Path, colmap: Path | None = None, transforms: Path | None = None) -> Dataset:
    """The photographs in ``images`` with the poses of a COLMAP model or of a ``transforms.json``.

    ``colmap`` is a folder with the model in or below it. Posed views without a photograph and photographs
    without a pose are left out, with a warning. A photograph may differ in size from its camera if the aspect
    ratio is the same. Raises ``InvalidInputError`` when none or both of the two are given, when fewer than
    two views remain, for poses that are not finite or not rotations, for photographs of another aspect ratio
    than their camera, and for photographs that their EXIF turns (their cameras would be ambiguous);
    ``StorageError`` when the model is damaged.
    """
    require_folder(images, "Give the folder of the photographs.")
    if colmap is not None and transforms is None:
        source = find_colmap_model(colmap)
        model = open_colmap(source)
        posed = _posed(model, source)
    elif transforms is not None and colmap is None:
        source, model, posed = transforms, None, import_transforms_json(transforms).views
    else:
        raise InvalidInputError(
            "A dataset needs its poses: one COLMAP model, or one transforms.json.",
            hint="Give either the folder of the model or the file.",
        )
    matches = match_files([view.name for view in posed], images)
    names, missing = matches.found, sorted(matches.missing)
    views = sorted(
        (
            View(names[view.name], _camera_of(view, images / names[view.name]), view.camera_from_model)
            for view in posed
            if view.name in names
        ),
        key=lambda view: view.name,
    )
    if len(views) < _MIN_VIEWS:
        raise InvalidInputError(
            f"{len(views)} of the {len(posed)} views in {source} have their photograph in {images}.",
            hint="Give the folder of photographs that these poses belong to.",
        )
    warnings = []
    if missing:
        code = FindingCode.VIEWS_WITHOUT_PHOTOGRAPH
        warnings.append(Finding.of(code, missing, of=len(posed), source=str(source)))
    unposed = sorted(map(readable_name, _photograph_names(images) - {view.name for view in views}))
    if unposed:
        warnings.append(Finding.of(FindingCode.PHOTOGRAPHS_WITHOUT_POSE, unposed))
    points = None if model is None else points_from_pycolmap(model, names)
    title = images.resolve().parent.name if images.name == "images" else images.name
    return Dataset(title, images, tuple(views), points, tuple(warnings))


def _posed(model: pycolmap.Reconstruction, folder: Path) -> tuple[AnyView, ...]:
    """The posed views of the model in ``folder``, with the model's cameras."""
    views = []
    for image in model.images.values():
        if not image.has_pose:
            continue
        try:
            camera_from_model = rigid_from_pycolmap(image.cam_from_world())
        except InvalidInputError as error:
            raise InvalidInputError(
                f"The pose of {image.name} in {folder} cannot be used: {error.message}",
                hint="Leave that image out of the model, or export it again.",
                path=folder,
            ) from error
        camera = camera_from_pycolmap(model.cameras[image.camera_id])
        views.append(View(image.name, camera, camera_from_model))
    if not views:
        raise InvalidInputError(
            f"No image of the model in {folder} has a pose.",
            hint="Give the model of a finished mapping.",
            path=folder,
        )
    return tuple(views)


def _camera_of(view: AnyView, photograph: Path) -> Camera:
    """The view's camera at the photograph's size."""
    try:
        with Image.open(photograph) as image:
            orientation = image.getexif().get(ExifTags.Base.Orientation, 1)
    except OSError as error:  # Pillow's errors derive from it
        raise InvalidInputError(
            f"{photograph} cannot be read as an image.",
            hint="Replace it, or leave it out of the dataset.",
            path=photograph,
        ) from error
    if orientation not in (0, 1):
        raise InvalidInputError(
            f"{photograph} is rotated (EXIF orientation {orientation}): its camera is ambiguous.",
            hint="Turn the pixels upright, remove the tag, and compute the poses from those images.",
            path=photograph,
        )
    return fit_camera(view.camera, photograph)


def _photograph_names(images: Path) -> set[str]:
    names = (
        path.relative_to(images).as_posix()
        for path in images.rglob("*")
        if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")
    )
    return {name for name in names if not is_mask(name)}


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
            path=folder,
        )
    return read_dataset(images, colmap, transforms)
