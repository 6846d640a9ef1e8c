"""Place photographs in a standing model without changing it, to judge it by photographs that it never saw."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.database import feature_counts
from fvs_engine.sfm.features import add_features, camera_groups, import_images
from fvs_engine.sfm.neighbours import Looks, match_with_neighbours
from fvs_engine.sfm.reconstruction import PosedView, Reconstruction, camera_from_pycolmap
from fvs_engine.sfm.stages import Stages


def localise(
    stages: Stages,
    image_dir: Path,
    names: Sequence[str],
    standing: Reconstruction,
    order: Sequence[str],
    model_dir: Path,
    database: Path,
    looks: Looks,
) -> dict[str, PosedView]:
    """The cameras of ``names`` in the model of ``model_dir`` (``standing``), without those it cannot place.

    ``stages`` has a database of its own for them, in which their features and matches are kept from call to
    call; features of standing images (``order`` is that of adding) are copied into it from ``database`` as
    they are needed, which is only read.
    """
    stages.folder.root.mkdir(parents=True, exist_ok=True)
    guests = stages.folder.database
    with stages.timed("features"):
        import_images(stages, image_dir, [*order, *names])
    add_features(stages, image_dir, names)
    counts = feature_counts(guests)
    usable = [name for name in names if counts.get(name, 0) > 0]

    def fetch(neighbours: Sequence[str]) -> None:
        stages.native(
            "copy_features", {"source": str(database), "target": str(guests), "names": list(neighbours)}
        )

    chosen = match_with_neighbours(stages, usable, order, standing.centres(), looks, fetch)
    groups = camera_groups(image_dir, [*order, *usable]).values()
    inside = set(order)
    siblings = {
        name: next(other for other in group if other in inside)
        for group in groups
        for name in group
        if name not in inside and inside & set(group)
    }
    stages.monitor.report("localisation", 0, len(usable))
    with stages.timed("localisation"):
        placed = stages.native(
            "locate",
            {
                "database": str(guests),
                "model_dir": str(model_dir),
                "neighbours": chosen,
                "siblings": siblings,
                "min_image_support": stages.settings.growth.min_image_support,
                "seed": stages.settings.seed,
            },
            on_event=lambda done: stages.monitor.report("localisation", done, len(usable)),
        )
    stages.monitor.report("localisation", len(usable), len(usable))
    return {name: _view(name, placed[name]) for name in names if name in placed}


def _view(name: str, placed: Mapping[str, Any]) -> PosedView:
    width, height = placed["size"]
    camera = pycolmap.Camera(model=placed["model"], width=width, height=height, params=placed["params"])
    matrix = np.array(placed["camera_from_model"])
    return PosedView(name, camera_from_pycolmap(camera), RigidTransform(matrix[:, :3], matrix[:, 3]))
