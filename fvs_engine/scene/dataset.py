"""A dataset: photographs with known poses, in the dataset's own frame."""

import shutil
from collections.abc import Container, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.folders import require_folder
from fvs_engine.images.catalog import SUFFIXES
from fvs_engine.images.names import match_files
from fvs_engine.scene.sparse_points import SparsePoints, points_from_pycolmap
from fvs_engine.sfm.colmap.imports import fit_camera, open_near
from fvs_engine.sfm.colmap.model import from_pycolmap, has_colmap_model
from fvs_engine.sfm.colmap.transforms_json import import_transforms_json, read_transforms_masks
from fvs_engine.views import AnyView
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.masks import MASKS, find_mask, is_mask
from fvs_schema.names import readable_name

_MIN_VIEWS = 2


@dataclass(frozen=True, eq=False)
class Dataset:
    """Photographs in ``image_dir`` with their poses; ``views`` are in order of capture, which is by name.

    A view's name is its photograph's posix path in ``image_dir``, its camera has the photograph's size, and
    its ``camera_from_model`` starts from the dataset's own model: a scene with known poses takes that as its
    model frame, a scene that estimates poses aligns with it. ``origin`` is the zero of that frame in the
    coordinates of the dataset's model (``near_origin``). ``points`` are those of the dataset's model, None
    when it has none. ``masks``: name of a view → its mask elsewhere, which counts where the folder has none;
    ``link_masks`` brings them to the readers of the folder. ``warnings`` are about what was left out.
    ``arriving``: photographs are added to the folder over time, may be deleted from it, and have no known
    poses; there are no views then, and a scene of it estimates poses by structure from motion.
    """

    name: str
    image_dir: Path
    views: tuple[AnyView, ...]
    points: SparsePoints | None = None
    masks: Mapping[str, Path] = field(default_factory=dict)
    warnings: tuple[Finding, ...] = field(default=())
    arriving: bool = False
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

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

    ``colmap`` is a folder with the model in or below it. The masks are those of the ``transforms.json``.
    Views without a photograph and photographs without a pose are left out, with a warning. Cameras
    belong to the stored pixels of their photographs, whatever the EXIF says; these may differ in size from
    the camera if the aspect ratio is the same. Raises ``InvalidInputError`` when none or both of the two are
    given, when fewer than two views remain, for poses that are not finite or not rotations, and for
    photographs of another aspect ratio than their camera; ``StorageError`` when the model is damaged.
    """
    require_folder(images, "Give the folder of the photographs.")
    model = None
    given: Mapping[str, Path | None] = {}
    if colmap is not None and transforms is None:
        source = colmap
        model, origin = open_near(colmap)
        posed = from_pycolmap(model).views
    elif transforms is not None and colmap is None:
        source = transforms
        imported = import_transforms_json(transforms, images)
        posed, origin = imported.views, imported.origin
        given = read_transforms_masks(transforms)
    else:
        raise InvalidInputError(
            "A dataset needs its poses: one COLMAP model, or one transforms.json.",
            hint="Give either the folder of the model or the file.",
        )
    no_images = {mask.resolve() for mask in given.values() if mask is not None}
    matches = match_files([view.name for view in posed], images, no_images)
    # Neither COLMAP nor JSON can hold other names.
    names = {view: file for view, file in matches.found.items() if file == readable_name(file)}
    missing = sorted(view.name for view in posed if view.name not in names)
    views = sorted(
        (
            replace(view, name=name, camera=fit_camera(view.camera, images / name))
            for view in posed
            if (name := names.get(view.name)) is not None
        ),
        key=lambda view: view.name,
    )
    if len(views) < _MIN_VIEWS:
        raise InvalidInputError(
            f"{len(views)} of the {len(posed)} views in {source} have their photograph in {images}.",
            hint="Give the folder of photographs that these poses belong to.",
        )
    warnings = list(matches.findings())
    if missing:
        code = FindingCode.VIEWS_WITHOUT_PHOTOGRAPH
        warnings.append(Finding.of(code, missing, of=len(posed), source=str(source)))
    unposed = sorted(map(readable_name, _photograph_names(images, no_images) - {view.name for view in views}))
    if unposed:
        warnings.append(Finding.of(FindingCode.PHOTOGRAPHS_WITHOUT_POSE, unposed))
    points = None if model is None else points_from_pycolmap(model, names)
    masks = {names[name]: mask for name, mask in given.items() if mask is not None and name in names}
    title = images.resolve().parent.name if images.name == "images" else images.name
    return Dataset(title, images, tuple(views), points, masks, tuple(warnings), origin=tuple(origin.tolist()))


def link_masks(dataset: Dataset, out: Path) -> Dataset:
    """The dataset with its ``masks`` in its folder: one of links in ``out`` to its photographs and masks.

    The same dataset if it has none. Raises ``OSError``.
    """
    if not dataset.masks:
        return dataset
    folder = out / ".dataset"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    images = folder / "images"
    images.symlink_to(dataset.image_dir.absolute())
    for name in dataset.names:
        mask = find_mask(dataset.image_dir, name) or dataset.masks.get(name)
        if mask is not None:
            link = folder / MASKS / f"{name}.png"
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(mask.absolute())
    return replace(dataset, image_dir=images, masks={})


def _photograph_names(images: Path, no_images: Container[Path]) -> set[str]:
    names = (
        path.relative_to(images).as_posix()
        for path in images.rglob("*")
        if path.suffix.lower() in SUFFIXES
        and not path.name.startswith(".")
        and (not no_images or path.resolve() not in no_images)
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
