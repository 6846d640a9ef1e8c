"""Structure from motion on a set of images: the stages, what is resumed, and the gate.

``out_dir`` holds ``database.db`` (features, matches; grows in transactions), ``calibrated.db`` and
``mapping/<mapper>/<k>`` (whole or absent: written beside and renamed), ``sparse`` (the chosen model),
``report.json`` and ``native.log`` (what the C++ printed).
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from fvs_engine.errors import ContradictedModelsError, ContradictedPositionsError, ReconstructionError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.images.names import listed
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import MappedModel, load_models, read_model_evidence, run_mapper
from fvs_engine.sfm.colmap.database import image_ids, verified_pair_count
from fvs_engine.sfm.colmap.model import from_pycolmap, read_colmap
from fvs_engine.sfm.matching.features import extract_features
from fvs_engine.sfm.matching.match import match_features
from fvs_engine.sfm.pose_priors import ImageSet, PosePriors
from fvs_engine.sfm.quarantine import CulpritError
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.report import GIVEN, CandidateReport, ComponentReport, SfmReport
from fvs_engine.sfm.settings import MapperName, SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages
from fvs_engine.sfm.verification.checks import Case
from fvs_engine.sfm.verification.evidence import ModelEvidence
from fvs_engine.sfm.verification.gate import Decision, decide
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES
from fvs_engine.wording import sentence
from fvs_schema.findings import Finding, FindingCode

_MIN_IMAGES = 2
_NEAR_CERTAIN = 0.95
"""Match support of the first mapper's model from which the second does not run on a large set."""


@dataclass(frozen=True, eq=False)
class SfmResult:
    """The chosen model, the evidence for it, and the folder of its COLMAP files."""

    reconstruction: Reconstruction
    report: SfmReport
    model_dir: Path


def reconstruct(images: ImageSet, out_dir: Path, settings: SfmSettings, monitor: Monitor) -> SfmResult:
    """Estimate the poses of ``images``, and points.

    What ``out_dir`` holds of the same images and settings is reused; a call after ``Cancelled`` resumes
    where the first one stopped, and a call after success returns at once. Progress is reported as the stages
    ``features``, ``pairs``, ``matching``, ``incremental mapping``, ``calibration``, ``global mapping``,
    ``evidence``. Pose priors move no camera, but a model that contradicts them is rejected.

    Images that crash pycolmap are quarantined: the report names them, and no later call uses them.

    Raises ``NoImagesError`` for fewer than two images, ``ReconstructionError`` when the images do not support
    a model (its hint is the remedy), ``Cancelled``.
    """
    folder = SfmFolder(out_dir)
    while True:
        usable = [name for name in images.names if name not in folder.quarantine.reasons]
        try:
            stages = Stages(folder, images.folder, settings, monitor)
            return _reconstruct(stages, usable, images.priors)
        except CulpritError as culprit:
            folder.quarantine.add(culprit)


def _reconstruct(stages: Stages, image_names: Sequence[str], priors: PosePriors | None) -> SfmResult:
    folder = stages.folder
    names = stages.open(image_names, _MIN_IMAGES)
    if (finished := finished_result(folder)) is not None and finished.report.mapper != GIVEN:
        return finished
    extract_features(stages, names)
    match_features(stages, names, priors)
    evidence = read_model_evidence(stages, priors)
    mapped = map_images(stages, len(names), evidence)
    decision = decide([each.judged for each in mapped], stages.settings.gate)
    return _conclude(stages, names, mapped, decision)


def finished_result(folder: SfmFolder) -> SfmResult | None:
    """The result of an earlier call in ``folder``, None if none has finished."""
    if not folder.report.is_file():
        return None
    try:
        report = SfmReport.model_validate_json(folder.report.read_bytes())
    except ValidationError:  # damaged, or of another version: it is computed again
        return None
    return SfmResult(read_colmap(folder.sparse), report, folder.sparse)


def map_images(stages: Stages, count: int, evidence: ModelEvidence) -> list[MappedModel]:
    """The models of one mapper, and those of the other where the gate leaves doubt about the first."""
    small = count <= stages.settings.incremental_first_up_to
    order: tuple[MapperName, ...] = ("incremental", "global") if small else ("global", "incremental")
    mapped: list[MappedModel] = []
    for mapper in order:
        models = load_models(run_mapper(stages, mapper, count))
        if models:
            mapped.append(
                MappedModel.of_models(mapper, models, evidence, stages.settings.gate, stages.monitor)
            )
        if mapped and _certain(mapped[-1], count, stages.settings):
            break
    return mapped


def _certain(mapped: MappedModel, count: int, settings: SfmSettings) -> bool:
    evidence = mapped.judged.evidence
    (judgement,) = decide([mapped.judged], settings.gate).judgements
    return (
        judgement.verdict == "accepted"
        and evidence is not None
        and evidence.match_support >= _NEAR_CERTAIN
        and len(mapped.judged.centres) >= 0.9 * count
    )


def _conclude(
    stages: Stages, names: Sequence[str], mapped: Sequence[MappedModel], decision: Decision
) -> SfmResult:
    """Write the chosen model and the report; raise when every model was rejected."""
    folder = stages.folder
    candidates = tuple(
        CandidateReport(
            mapper=each.judged.mapper,
            registered=len(each.judged.centres),
            points=each.model.num_points3D(),
            mean_reprojection_error_px=each.model.compute_mean_reprojection_error(),
            evidence=each.judged.evidence,
            verdict=judgement.verdict,
            reasons=judgement.reasons,
        )
        for each, judgement in zip(mapped, decision.judgements, strict=True)
    )
    if decision.chosen is None:
        rejected = json.dumps([candidate.model_dump() for candidate in candidates], indent=2)
        write_text_atomically(folder.rejected, rejected)
        raise _failure(stages, names, candidates)

    chosen = mapped[decision.chosen]
    reconstruction = from_pycolmap(chosen.model)
    report = _report(stages, names, chosen, candidates, decision)
    stages.write_model(chosen.model)
    write_text_atomically(folder.report, report.model_dump_json(indent=2))
    return SfmResult(reconstruction, report, folder.sparse)


def _report(
    stages: Stages,
    names: Sequence[str],
    chosen: MappedModel,
    candidates: tuple[CandidateReport, ...],
    decision: Decision,
) -> SfmReport:
    kept = next(each for each in candidates if each.mapper == chosen.judged.mapper)
    components = tuple(
        ComponentReport(mapper=kept.mapper, images=images) for images in chosen.other_components
    )
    quarantined = stages.folder.quarantine.reasons
    warnings = [*stages.warnings, *decision.warnings, *quarantined.values()]
    warnings += model_warnings(names, chosen)
    return SfmReport(
        mapper=kept.mapper,
        verdict=kept.verdict,
        images=len(names),
        registered=kept.registered,
        unregistered=_unregistered(names, chosen),
        points=kept.points,
        mean_reprojection_error_px=kept.mean_reprojection_error_px,
        pairs_matched=stages.pairs_matched,
        pairs_verified=verified_pair_count(stages.folder.database, MIN_PAIR_MATCHES),
        candidates=candidates,
        agreements=decision.agreements,
        other_components=components,
        warnings=tuple(warnings),
        seconds=stages.seconds,
    )


def model_warnings(names: Sequence[str], chosen: MappedModel) -> list[Finding]:
    """Warnings about a model of the images ``names``: those without a pose, or with a weak one."""
    explained = {*chosen.left_out, *chosen.with_few_points}.union(*chosen.other_components)
    evidence = chosen.judged.evidence
    found = (
        (FindingCode.UNREGISTERED, [name for name in _unregistered(names, chosen) if name not in explained]),
        *((FindingCode.SEPARATE_MODEL, images) for images in chosen.other_components),
        (FindingCode.LEFT_OUT, chosen.left_out),
        (FindingCode.FEW_POINTS, chosen.with_few_points),
        (FindingCode.WEAK_POSES, () if evidence is None else evidence.unsupported_images),
    )
    return [Finding.of(code, images, of=len(names)) for code, images in found if images]


def _unregistered(names: Sequence[str], mapped: MappedModel) -> tuple[str, ...]:
    return tuple(name for name in names if name not in mapped.judged.centres)


def _failure(
    stages: Stages, names: Sequence[str], candidates: Sequence[CandidateReport]
) -> ReconstructionError:
    verified = verified_pair_count(stages.folder.database, MIN_PAIR_MATCHES)
    shown = listed(names)
    if verified == 0:
        return ReconstructionError(
            f"No two of the {len(image_ids(stages.folder.database))} images overlap ({shown}).",
            hint="Take photographs that overlap by two thirds, of something with texture.",
        )
    if not candidates:
        pairs = "1 pair" if verified == 1 else f"{verified} pairs"
        return ReconstructionError(
            f"The images support no model, although {pairs} of them match ({shown}).",
            hint="Add photographs from in between, taken from different places rather than by turning.",
        )
    reasons = "; ".join(
        f"{candidate.mapper}: {' '.join(map(sentence, candidate.reasons))}" for candidate in candidates
    )
    message = f"Every model contradicts the images' matches or positions. {reasons}"
    if any(
        Case(candidate.evidence, candidate.registered, stages.settings.gate).contradicts_priors
        for candidate in candidates
        if candidate.evidence is not None
    ):
        return ContradictedPositionsError(
            message,
            hint="The positions may be wrong: check their units, axes and altitude datum, and whether they "
            "belong to these images; or leave them out. If they are right, places that look alike were "
            "confused: photograph from farther away, with something unique in view, and in between.",
        )
    return ContradictedModelsError(
        message,
        hint="Places that look alike cause this, a zoom that EXIF does not record, or a wrong camera model. "
        "Take photographs from farther away, which include something unique, and some in between; do not "
        "zoom; give positions, as GPS in EXIF or with the upload. If the camera is the cause, give its "
        "calibration, or cameras that another program computed.",
    )
