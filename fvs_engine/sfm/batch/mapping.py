"""Stage three: the two mappers, their models on disk, and the evidence for each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.colmap.database import (
    focal_length_priors,
    image_ids,
    publish,
    read_keypoints,
    read_verified_pairs,
    require_sound_database,
    verified_pair_count,
)
from fvs_engine.sfm.colmap.model import camera_centres, has_colmap_model, open_colmap
from fvs_engine.sfm.jobs import CalibrateViewGraph, MapGlobally, MapImages, MapIncrementally
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.settings import GateSettings, MapperName
from fvs_engine.sfm.stages import Stages, fresh_folder, rename_over
from fvs_engine.sfm.verification.checks import Case
from fvs_engine.sfm.verification.evidence import ModelEvidence
from fvs_engine.sfm.verification.gate import JudgedModel
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES
from fvs_engine.sfm.verification.positions import usable_priors
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.stages import Stage

_MAPPERS: Mapping[MapperName, tuple[type[MapImages], Stage]] = {
    "incremental": (MapIncrementally, Stage.INCREMENTAL_MAPPING),
    "global": (MapGlobally, Stage.GLOBAL_MAPPING),
}

_FEW_POINTS_SHARE = 0.1
"""An image that sees less than this share of the median number of points sees far fewer than others."""


@dataclass(frozen=True, eq=False)
class MappedModel:
    """A mapper's largest model with the evidence for it, and the images of its smaller models.

    Images that were removed from the model: ``left_out``, because the evidence contradicts their poses, and
    ``with_few_points``, because they see hardly any points.
    """

    model: pycolmap.Reconstruction
    judged: JudgedModel
    other_components: tuple[tuple[str, ...], ...]
    left_out: tuple[str, ...] = ()
    with_few_points: tuple[str, ...] = ()

    @staticmethod
    def of_models(
        mapper: str,
        models: Sequence[pycolmap.Reconstruction],
        evidence_of: ModelEvidence,
        gate: GateSettings,
        monitor: Monitor,
    ) -> "MappedModel":
        """Gather the evidence for the largest of ``models`` (sorted, largest first).

        Images that see hardly any points are removed when they are few, and so are those that every pair or
        their position prior contradicts.
        """
        monitor.report(Stage.EVIDENCE, 0, 1)
        monitor.check()
        largest = models[0]
        with_few_points = _with_few_points(largest, gate)
        leave_out(largest, with_few_points)
        evidence = evidence_of.of(largest, monitor)
        left_out = [] if evidence is None else _prunable(Case(evidence, largest.num_reg_images(), gate))
        if evidence is not None and left_out:
            leave_out(largest, left_out)
            evidence = evidence_of.of(largest, monitor)
        monitor.report(Stage.EVIDENCE, 1, 1)
        others = tuple(registered_names(model) for model in models[1:])
        judged = JudgedModel(mapper, camera_centres(largest), evidence)
        return MappedModel(largest, judged, others, tuple(left_out), tuple(with_few_points))


def read_model_evidence(stages: Stages, priors: PosePriors | None = None) -> ModelEvidence:
    """Read pairs, keypoints and position priors; ``priors`` replace the positions in the images' metadata."""
    pairs = read_verified_pairs(stages.folder.database, MIN_PAIR_MATCHES)
    ids = {pair.first for pair in pairs} | {pair.second for pair in pairs}
    keypoints = read_keypoints(stages.folder.database, ids)
    usable, warnings = usable_priors(priors, stages.folder.database)
    stages.warnings.extend(warnings)
    return ModelEvidence(pairs, keypoints, usable, focal_length_priors(stages.folder.database))


def calibrate_view_graph(stages: Stages) -> None:
    """Write ``calibrated.db`` unless it exists, nothing was matched, or the intrinsics are known."""
    folder = stages.folder
    if folder.calibrated.exists() or stages.settings.intrinsics is not None:
        return
    if verified_pair_count(folder.database, MIN_PAIR_MATCHES) == 0:
        return
    require_sound_database(folder.database)  # and its journal is in the file that is copied next
    partial = folder.partial(folder.calibrated)
    stages.monitor.report(Stage.CALIBRATION, 0, 1)
    with stages.timed("calibration"):
        calibrated = stages.native_over(
            sorted(image_ids(folder.database)),
            lambda some: CalibrateViewGraph(
                database=folder.database, target=partial, names=tuple(some), seed=stages.settings.seed
            ),
        )
        if not calibrated:
            stages.warnings.append(Finding.of(FindingCode.UNCALIBRATED))
        publish(partial, folder.calibrated)
    stages.monitor.report(Stage.CALIBRATION, 1, 1)


def run_mapper(stages: Stages, mapper: MapperName, count: int) -> Path:
    """Run ``mapper`` unless its models exist; returns their folder.

    The global one starts from the focal lengths of the view graph, which is calibrated first.
    """
    target = stages.folder.mapping(mapper)
    if target.is_dir() or verified_pair_count(stages.folder.database, MIN_PAIR_MATCHES) == 0:
        return target
    if mapper == "global":
        calibrate_view_graph(stages)
    request, stage = _MAPPERS[mapper]
    partial = stages.folder.partial(target)
    database = _mapping_database(stages) if mapper == "global" else stages.folder.database
    stages.monitor.report(stage, 0, count if mapper == "incremental" else None)
    with stages.timed(stage):
        stages.native_over(
            sorted(image_ids(database)),
            lambda some: request(
                database=database,
                image_dir=stages.image_dir,
                out_dir=fresh_folder(partial),
                names=tuple(some),
                refine=stages.settings.intrinsics is None,
                lens=stages.settings.camera_model is None,
                seed=stages.settings.seed,
                threads=stages.settings.threads,
            ),
            on_event=lambda registered: stages.monitor.report(stage, min(registered, count), count),
        )
    rename_over(partial, target)
    stages.monitor.report(stage, count, count)
    return target


def load_models(folder: Path) -> list[pycolmap.Reconstruction]:
    """The models in ``folder``/0, 1, …, the one with the most images first."""
    if not folder.is_dir():
        return []
    models = [open_colmap(model) for model in sorted(folder.iterdir()) if has_colmap_model(model)]
    return sorted(models, key=lambda model: model.num_reg_images(), reverse=True)


def registered_names(model: pycolmap.Reconstruction) -> tuple[str, ...]:
    """The names of the images that have a pose, sorted."""
    return tuple(sorted(image.name for image in model.images.values() if image.has_pose))


def leave_out(model: pycolmap.Reconstruction, names: Sequence[str]) -> None:
    """Remove the poses of these images, and their observations, from the model."""
    for name in names:
        image = model.find_image_with_name(name)
        if image is not None and image.has_pose:
            model.deregister_frame(image.frame_id)


def _with_few_points(model: pycolmap.Reconstruction, gate: GateSettings) -> list[str]:
    """The images that see hardly any points, unless they are many.

    The global mapper averages rotations and keeps poses that its triangulation does not support: of 30 images
    with fewer than 15 points in 115 models 28 were wrong.
    """
    seen = {image.name: image.num_points3D for image in model.images.values() if image.has_pose}
    if not seen:
        return []
    least = min(MIN_PAIR_MATCHES, _FEW_POINTS_SHARE * float(np.median(list(seen.values()))))
    few = sorted(name for name, points in seen.items() if points < least)
    usable = len(seen) - len(few) >= gate.min_shared_images
    return few if usable and len(few) <= gate.max_misplaced_share * len(seen) else []


def _prunable(case: Case) -> list[str]:
    """The images that the evidence contradicts; of each kind only if they are few enough to be removed."""
    evidence = case.evidence
    found: set[str] = set()
    for names in (evidence.unsupported_images, evidence.misscaled_images):
        if not case.are_many(names):
            found.update(names)
    if not case.priors_are_wrong and not case.has_many_misplaced:
        found.update(evidence.misplaced_images)
    return sorted(found)


def _mapping_database(stages: Stages) -> Path:
    calibrated = stages.folder.calibrated
    return calibrated if calibrated.exists() else stages.folder.database
