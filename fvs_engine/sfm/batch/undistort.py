"""Undistortion: the pinhole images that the rasterisers render."""

from collections.abc import Sequence
from pathlib import Path

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import registered_names
from fvs_engine.sfm.colmap.model import has_colmap_model, open_colmap, read_colmap
from fvs_engine.sfm.culprit import run_or_accuse
from fvs_engine.sfm.jobs import UndistortImages
from fvs_engine.sfm.native_process import run_native
from fvs_engine.sfm.quarantine import CulpritError
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.stages import fresh_folder, rename_over
from fvs_schema.stages import Stage

_JPEG_QUALITY = 99


def undistort(reconstruction_dir: Path, image_dir: Path, out_dir: Path, monitor: Monitor) -> Reconstruction:
    """Undistort the posed images of the COLMAP model in ``reconstruction_dir``.

    ``out_dir`` gets ``sparse`` (a COLMAP model with pinhole cameras), ``images`` (the same names) and the
    ``masks`` of masked ones; it appears when it is whole, and an existing one is kept. Progress is stage
    ``undistort``. Raises ``StorageError`` for a damaged model, ``CulpritError`` when a single image crashes
    it, ``ReconstructionError``, ``Cancelled``.
    """
    sparse = out_dir / "sparse"
    if has_colmap_model(sparse):
        return read_colmap(sparse)
    names = registered_names(open_colmap(reconstruction_dir))
    total = len(names)
    partial = out_dir.with_name(f".{out_dir.name}.partial")
    written = partial / "images"

    def report() -> None:
        done = sum(1 for path in written.rglob("*") if path.is_file()) if written.is_dir() else 0
        monitor.report(Stage.UNDISTORT, min(done, total), total)

    log = out_dir.with_name(f"{out_dir.name}.log")

    def run(some: Sequence[str]) -> None:
        request = UndistortImages(
            model_dir=reconstruction_dir,
            image_dir=image_dir,
            out_dir=fresh_folder(partial),
            names=tuple(some),
            jpeg_quality=_JPEG_QUALITY,
        )
        run_native(request, log, monitor, on_tick=report)

    accused = run_or_accuse(run, names)
    if accused is not None:
        raise CulpritError(*accused)
    rename_over(partial, out_dir)
    log.unlink(missing_ok=True)
    monitor.report(Stage.UNDISTORT, total, total)
    return read_colmap(sparse)
