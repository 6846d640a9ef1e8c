"""Undistortion: the pinhole images that the rasterisers render."""

from pathlib import Path

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.colmap.model import has_colmap_model, open_colmap, read_colmap
from fvs_engine.sfm.native_process import run_native
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.stages import fresh_folder, rename_over

_JPEG_QUALITY = 99


def undistort(reconstruction_dir: Path, image_dir: Path, out_dir: Path, monitor: Monitor) -> Reconstruction:
    """Undistort the posed images of the COLMAP model in ``reconstruction_dir``.

    ``out_dir`` gets ``sparse`` (a COLMAP model with pinhole cameras) and ``images`` (the same names); it
    appears when it is whole, and an existing one is kept. Progress is stage ``undistort``.
    Raises ``StorageError`` for a damaged model, ``ReconstructionError``, ``Cancelled``.
    """
    sparse = out_dir / "sparse"
    if has_colmap_model(sparse):
        return read_colmap(sparse)
    total = open_colmap(reconstruction_dir).num_reg_images()
    partial = fresh_folder(out_dir.with_name(f".{out_dir.name}.partial"))
    written = partial / "images"

    def report() -> None:
        done = sum(1 for path in written.rglob("*") if path.is_file()) if written.is_dir() else 0
        monitor.report("undistort", min(done, total), total)

    arguments = {
        "model_dir": str(reconstruction_dir),
        "image_dir": str(image_dir),
        "out_dir": str(partial),
        "quality": _JPEG_QUALITY,
    }
    log = out_dir.with_name(f"{out_dir.name}.log")
    run_native("undistort", arguments, log, monitor, on_tick=report)
    rename_over(partial, out_dir)
    log.unlink(missing_ok=True)
    monitor.report("undistort", total, total)
    return read_colmap(sparse)
