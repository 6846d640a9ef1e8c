"""Reconstruction of a folder of photographs: cameras and a trained splat; every stage can be resumed."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

from fvs_engine.errors import InvalidInputError, NoImagesError, OutputExistsError
from fvs_engine.files.owned_folder import differences
from fvs_engine.files.storage import require_free_bytes, storage_errors
from fvs_engine.hold_out import require_views_left
from fvs_engine.images.catalog import ImageCatalog, Photograph, catalog_images
from fvs_engine.images.normalise import normalise_images, normalised_name
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.manifest import (
    ImageRecord,
    ImagesRecord,
    Manifest,
    Metrics,
    ReconstructionSettings,
    RejectionRecord,
)
from fvs_engine.pipeline.workspace import Workspace
from fvs_schema.findings import Finding, FindingCode, Severity

MIN_PHOTOGRAPHS = 2
_BYTES_PER_PIXEL = 4
"""Disk space for a normalised and an undistorted copy of each photograph, at most."""
_BYTES_PER_PHOTOGRAPH = 4_000_000
"""Disk space for its features and matches."""

_LASTING = (
    *("quality", "training_long_side_px", "test_every", "seed"),
    *("colmap", "transforms", "camera_model", "intrinsics", "gps"),
)
"""The settings that a resumed reconstruction must share with the one that it resumes."""


def reconstruct_folder(
    photographs: Path,
    out: Path,
    settings: ReconstructionSettings,
    *,
    overwrite: bool = False,
    monitor: Monitor | None = None,
    threads: int | None = None,
) -> Metrics:
    """Reconstruct ``photographs`` into the folder ``out``; resumes what is there.

    The same call on the same folder resumes it; with more ``iterations`` it trains on. The backend and the
    number of threads may differ, too; for anything else ``OutputExistsError`` names what differs. Until the
    cameras are estimated, all settings may differ and photographs may be added. ``overwrite`` deletes an
    earlier result first. Files that cannot be used are left out with a warning.

    Raises ``NoImagesError`` for fewer than two photographs, ``ReconstructionError`` when they support no
    model, ``TrainingError``, ``StorageError`` (``DiskFullError``, ``OutputExistsError``), ``Cancelled``;
    after each of them the folder holds the last good state.
    """
    monitor = monitor or Monitor()
    if settings.colmap and settings.transforms:
        raise InvalidInputError(
            "Cameras can come from one source only.", hint="Give either --colmap or --transforms."
        )
    if settings.intrinsics and settings.camera_model:
        raise InvalidInputError(
            f"The intrinsics are those of a {settings.intrinsics.model} camera already.",
            hint="Give either --intrinsics or --camera-model.",
        )
    if (settings.colmap or settings.transforms) and (settings.intrinsics or settings.camera_model):
        raise InvalidInputError(
            "Imported cameras have their intrinsics already.",
            hint="Leave out --intrinsics and --camera-model, or --colmap and --transforms.",
        )
    require_views_left(settings.test_every)
    for what, given in (
        ("photographs", str(photographs)),
        ("cameras", settings.colmap),
        ("cameras", settings.transforms),
    ):
        if given is not None and Path(given).resolve().is_relative_to(out.resolve()):
            raise InvalidInputError(
                f"The {what} in {given} lie inside the output folder {out}, and could be overwritten.",
                hint="Choose an output folder outside.",
            )
    masks = _given_masks(settings)
    catalog = catalog_images(photographs, leave_out=out, masks=masks, monitor=monitor, threads=threads)
    for rejected in catalog.rejected:
        monitor.warn(
            Finding.of(
                FindingCode.UNUSABLE_PHOTOGRAPH,
                [rejected.name],
                why=rejected.reason,
                remedy=rejected.hint,
            )
        )
    _require_photographs(catalog)
    without = [photograph.name for photograph in catalog.photographs if not photograph.masked]
    if 0 < len(without) < len(catalog.photographs):
        monitor.warn(Finding.of(FindingCode.WITHOUT_MASK, without, of=len(catalog.photographs)))

    workspace = Workspace(out)
    with workspace.locked():
        if overwrite:
            workspace.clear()
        manifest = _open_manifest(workspace, settings, _images_record(catalog, settings))
        return _compute(workspace, manifest, catalog, monitor, threads)


def _compute(
    workspace: Workspace,
    manifest: Manifest,
    catalog: ImageCatalog,
    monitor: Monitor,
    threads: int | None,
) -> Metrics:
    """The long stages; imported here, so that invalid input is reported before their slow import."""
    from fvs_engine.compilation.kernels import set_thread_budget
    from fvs_engine.pipeline.cameras import find_cameras
    from fvs_engine.pipeline.train import disk_need_bytes, train

    if threads is not None:
        set_thread_budget(threads)
    if manifest.cameras is None:
        pixels = sum(photograph.width_px * photograph.height_px for photograph in catalog.photographs)
        copies = _BYTES_PER_PIXEL * pixels + _BYTES_PER_PHOTOGRAPH * len(catalog.photographs)
        require_free_bytes(workspace.root, copies + disk_need_bytes(manifest.settings))
        records = manifest.images.photographs
        as_stored = frozenset(record.normalised_name for record in records if record.as_stored)
        if as_stored:
            monitor.warn(Finding.of(FindingCode.PIXELS_AS_STORED, sorted(as_stored), Severity.NOTE))
        with storage_errors(workspace.images):
            normalise_images(
                catalog.photographs, workspace.images, as_stored=as_stored, monitor=monitor, threads=threads
            )
        manifest = find_cameras(workspace, manifest, monitor=monitor, threads=threads)
    return train(workspace, manifest, monitor=monitor)


def _given_masks(settings: ReconstructionSettings) -> Mapping[str, Path | None]:
    """Frame → its mask, by the ``transforms.json``."""
    if settings.transforms is None:
        return {}
    from fvs_engine.sfm.colmap.transforms_json import read_transforms_masks

    return read_transforms_masks(Path(settings.transforms))


def _require_photographs(catalog: ImageCatalog) -> None:
    count = len(catalog.photographs)
    if count >= MIN_PHOTOGRAPHS:
        return
    if count == 1:
        message = f"{catalog.folder} holds only one usable photograph, {catalog.photographs[0].name}."
    else:
        message = f"{catalog.folder} holds no usable photograph."
    if catalog.rejected:
        first, *others = catalog.rejected
        message += f" Left out: {first.name}: {first.reason}"
        message += f" And {len(others)} more." if others else ""
    raise NoImagesError(
        message, hint="Give at least two photographs of the same scene that overlap; ten or more work well."
    )


def _images_record(catalog: ImageCatalog, settings: ReconstructionSettings) -> ImagesRecord:
    images = ImagesRecord(
        folder=str(catalog.folder.absolute()),
        photographs=tuple(
            ImageRecord(
                name=photograph.name,
                normalised_name=normalised_name(photograph),
                sha256=photograph.sha256,
                masked=photograph.masked,
                mask_sha256=photograph.mask and hashlib.sha256(photograph.mask.read_bytes()).hexdigest(),
            )
            for photograph in catalog.photographs
        ),
        rejected=tuple(
            RejectionRecord(name=image.name, reason=image.reason, hint=image.hint)
            for image in catalog.rejected
        ),
    )
    turned = {
        normalised_name(photograph): photograph for photograph in catalog.photographs if photograph.turned
    }
    if not turned or not (settings.colmap or settings.transforms):
        return images
    as_stored = _as_stored(images, settings, turned)
    photographs = tuple(
        record.model_copy(update={"as_stored": record.normalised_name in as_stored})
        for record in images.photographs
    )
    return images.model_copy(update={"photographs": photographs})


def _as_stored(
    images: ImagesRecord, settings: ReconstructionSettings, turned: Mapping[str, Photograph]
) -> frozenset[str]:
    """Those of the photographs ``turned`` by their EXIF whose given cameras belong to their stored pixels.

    That is all but those whose camera has the shape of the upright image, and not that of the stored one.
    """
    from fvs_engine.images.pixels import stored_size
    from fvs_engine.pipeline.cameras import import_given
    from fvs_engine.sfm.colmap.imports import has_shape

    given = import_given(settings, images)
    cameras = {} if given is None else {view.name: view.camera for view in given.cameras.views}
    return frozenset(
        name
        for name, photograph in turned.items()
        if name in cameras
        and (
            has_shape(cameras[name], *stored_size(photograph.path))
            or not has_shape(cameras[name], photograph.width_px, photograph.height_px)
        )
    )


def _open_manifest(workspace: Workspace, settings: ReconstructionSettings, images: ImagesRecord) -> Manifest:
    """Read the folder's manifest or create it; raise when it is that of another reconstruction."""
    earlier = workspace.read_manifest()
    if earlier is None:
        manifest = Manifest(settings=settings, images=images)
    else:
        _require_compatible(workspace, earlier, settings, images)
        _delete_otherwise_turned(workspace, earlier.images, images)
        manifest = earlier.model_copy(update={"settings": settings, "images": images})
    workspace.write_manifest(manifest)
    return manifest


def _delete_otherwise_turned(workspace: Workspace, earlier: ImagesRecord, images: ImagesRecord) -> None:
    """Delete normalised photographs that are upright and should be as they are stored, or the reverse."""
    before = {record.normalised_name: record.as_stored for record in earlier.photographs}
    with storage_errors(workspace.images):
        for record in images.photographs:
            if before.get(record.normalised_name, record.as_stored) != record.as_stored:
                (workspace.images / record.normalised_name).unlink(missing_ok=True)


def _require_compatible(
    workspace: Workspace, earlier: Manifest, settings: ReconstructionSettings, images: ImagesRecord
) -> None:
    # Until there are cameras, other settings and more photographs are the remedy for a rejected model;
    # structure from motion deletes outdated files itself.
    settled = earlier.cameras is not None
    old, new = ({name: getattr(each, name) for name in _LASTING} for each in (earlier.settings, settings))
    changed = differences(old, new) if settled else []
    known = {record.sha256: record.name for record in earlier.images.photographs}
    given = {record.sha256: record.name for record in images.photographs}
    added = sorted(name for sha256, name in given.items() if known.get(sha256) != name)
    removed = sorted(name for sha256, name in known.items() if given.get(sha256) != name)
    if added and (settled or removed):
        changed.append(_counted(added, "new"))
    if removed:
        changed.append(_counted(removed, "gone"))
    masks = {record.name: record.mask_sha256 for record in earlier.images.photographs}
    masked = [
        record.name
        for record in images.photographs
        if record.name in masks and masks[record.name] != record.mask_sha256
    ]
    if masked and settled:
        changed.append(_counted(masked, "masked otherwise"))
    if changed:
        raise OutputExistsError(
            f"{workspace.root} holds another reconstruction: {'; '.join(changed)}.",
            hint="Give another --out, or start again there with --overwrite.",
            path=workspace.root,
        )


def _counted(names: list[str], what: str) -> str:
    if len(names) == 1:
        return f"1 photograph is {what} ({names[0]})"
    return f"{len(names)} photographs are {what} ({names[0]}, …)"
