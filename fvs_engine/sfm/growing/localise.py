"""Localise images in the current model without adding them, for evaluation on unused images."""

import contextlib
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pycolmap

from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.colmap.database import delete_database, feature_counts, require_sound_database
from fvs_engine.sfm.colmap.model import camera_from_pycolmap
from fvs_engine.sfm.colmap.part_database import differing_features
from fvs_engine.sfm.growing.neighbours import Surroundings, match_with_neighbours
from fvs_engine.sfm.growing.state import GrowthFolder
from fvs_engine.sfm.jobs import CopyFeatures, LocalisedImage, LocaliseImages
from fvs_engine.sfm.matching.features import add_features, camera_groups, import_images
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.settings import FeatureSettings
from fvs_engine.sfm.stages import Stages
from fvs_engine.views import AnyView, View
from fvs_schema.stages import Stage


def localise(
    stages: Stages, folder: GrowthFolder, names: Sequence[str], around: Surroundings, priors: PosePriors
) -> dict[str, AnyView]:
    """Estimate the poses of ``names`` in the model ``around`` them; failures are left out.

    ``stages`` has a database of its own for them, which keeps their features and matches from call to call;
    features of registered images are copied into it from that of ``folder``, which is only read. Raises
    ``CulpritError`` when one of ``names`` crashes a job.
    """
    order, database, model_dir = around.earlier, folder.sfm.database, folder.current_model
    assert model_dir is not None
    stages.folder.root.mkdir(parents=True, exist_ok=True)
    guest_database = stages.folder.database
    require_sound_database(guest_database)
    features = stages.settings.features(len(order))
    _delete_if_changed(stages, names, features)
    stages.folder.remove_images(differing_features(guest_database, database))
    with stages.timed("features"):
        import_images(stages, [*order, *names])
    add_features(stages, names, features)
    counts = feature_counts(guest_database)
    usable = [name for name in names if counts.get(name, 0) > 0]

    def fetch(neighbours: Sequence[str]) -> None:
        here = feature_counts(guest_database)
        names = [name for name in neighbours if name not in here]
        if names:
            request = CopyFeatures(source=database, target=guest_database, names=tuple(names))
            stages.native(request)  # copies rows only: no image can crash it

    chosen = match_with_neighbours(stages, usable, around, fetch)
    groups = camera_groups(stages.image_dir, [*order, *usable], stages.settings.focal_prior)
    inside = set(order)
    siblings = {
        name: next(other for other in group.names if other in inside)
        for group in groups
        for name in group.names
        if name not in inside and inside & set(group.names)
    }
    stages.monitor.report(Stage.LOCALISATION, 0, len(usable))
    with stages.timed("localisation"):
        answer = stages.native_over(
            list(chosen),
            lambda some: LocaliseImages(
                database=guest_database,
                model_dir=model_dir,
                neighbours={name: tuple(chosen[name]) for name in some},
                siblings=siblings,
                priors=priors,
                min_image_support=stages.settings.growth.min_image_support,
                seed=stages.settings.seed,
            ),
            on_event=lambda done: stages.monitor.report(Stage.LOCALISATION, done, len(usable)),
        )
    stages.monitor.report(Stage.LOCALISATION, len(usable), len(usable))
    found = answer.images
    return {name: _view(name, found[name]) for name in names if name in found}


def _delete_if_changed(stages: Stages, names: Sequence[str], features: FeatureSettings) -> None:
    """Delete the database if its features are of other settings, or of other files by these names."""
    folder = stages.folder
    known: dict[str, Any] = {}
    with contextlib.suppress(OSError, ValueError):
        known = json.loads(folder.state.read_text(encoding="utf-8"))
    wanted = features.model_dump(mode="json")
    before = known.get("images", {})
    sizes = {name: (stages.image_dir / name).stat().st_size for name in names}
    if known.get("features") != wanted or any(before.get(name, size) != size for name, size in sizes.items()):
        delete_database(folder.database)
        folder.quarantine.release(names)
        before = {}
    write_text_atomically(folder.state, json.dumps({"features": wanted, "images": before | sizes}))


def _view(name: str, image: LocalisedImage) -> AnyView:
    camera = pycolmap.Camera(model=image.model, width=image.width, height=image.height, params=image.params)
    matrix = np.array(image.camera_from_model)
    return View(name, camera_from_pycolmap(camera), RigidTransform(matrix[:, :3], matrix[:, 3]))
