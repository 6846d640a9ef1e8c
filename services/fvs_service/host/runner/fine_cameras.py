"""The cameras that a scene's fine model is trained with."""

from collections.abc import Collection
from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_engine.sfm.batch.mapping import leave_out, registered_names
from fvs_engine.sfm.colmap.model import open_colmap, read_colmap
from fvs_engine.sfm.growing.state import GrowthFolder
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.stages import fresh_folder


def fine_cameras(growth: GrowthFolder, fine: Path, images: Collection[str]) -> Reconstruction:
    """Those of the current model at the first call; later updates do not change them. Kept in ``fine``.

    When one of the ``images`` has been left out since, the training starts again without it. Raises
    ``InvalidInputError`` when there is no model.
    """
    kept = fine / "sparse"
    if kept.exists() and any(view.name not in images for view in read_colmap(kept).views):
        fresh_folder(fine)
    if not kept.exists():
        model_dir = growth.current_model
        if model_dir is None:
            raise InvalidInputError("The scene has no cameras yet.", hint="Run an update first.")
        partial = fresh_folder(fine / "sparse.partial")
        model = open_colmap(model_dir)
        leave_out(model, [name for name in registered_names(model) if name not in images])
        model.write_binary(partial)
        partial.rename(kept)
    return read_colmap(kept)
