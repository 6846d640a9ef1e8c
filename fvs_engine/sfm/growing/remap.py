"""Models of all images together, which may replace the model of a growing reconstruction."""

from collections.abc import Sequence
from pathlib import Path

import pycolmap

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import align_poses
from fvs_engine.sfm.batch.mapping import MappedModel, read_model_evidence, registered_names
from fvs_engine.sfm.batch.reconstruct import map_images, model_warnings
from fvs_engine.sfm.colmap.model import camera_poses, move, open_colmap
from fvs_engine.sfm.growing.state import GrowthState, ModelChange
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.settings import GateSettings, SfmSettings
from fvs_engine.sfm.stages import Stages, fresh_folder
from fvs_engine.sfm.verification.evidence import ModelEvidence
from fvs_engine.sfm.verification.gate import JudgedModel, Judgement, agree, decide
from fvs_schema.findings import Finding, FindingCode, Severity

_CURRENT = "current"
"""Used instead of a mapper's name for the grown model."""

_MIN_GAIN = 1.02
"""Factor by which a new model must explain more matches than the current one to replace it."""


def reason_to_remap(
    state: GrowthState, match_support: float | None, unregistered: int, settings: SfmSettings
) -> Finding | None:
    """Why a re-map is due, None if it is not.

    ``unregistered`` counts the images that match registered ones and have no pose. A re-map costs as much as
    a new reconstruction, less features and matches: it is not repeated before the images have grown by a
    share.
    """
    growth = settings.growth
    if len(state.images) < (1.0 + growth.remap_every) * state.mapped_images:
        return None
    if match_support is not None and match_support < state.mapped_support - growth.max_support_loss:
        before = state.mapped_support
        return Finding.of(FindingCode.SUPPORT_FELL, severity=Severity.NOTE, before=before, now=match_support)
    if unregistered > 0 and unregistered >= growth.max_unregistered * len(state.registered):
        return Finding.of(FindingCode.MANY_UNREGISTERED, severity=Severity.NOTE, unregistered=unregistered)
    return None


def remap(
    stages: Stages, state: GrowthState, priors: PosePriors, model_dir: Path, out_dir: Path
) -> ModelChange:
    """Run the mappers again on all images; the gate chooses between their models and that in ``model_dir``.

    A new model that is chosen is aligned with the current one and written to ``out_dir``.
    """
    evidence, mapped = _map_all(stages, state, priors)
    current = open_colmap(model_dir)
    models = [_as_mapped(stages, current, evidence), *mapped]
    decision = decide([each.judged for each in models], stages.settings.gate)
    chosen = decision.chosen or 0
    if chosen > 0 and decision.judgements[0].verdict != "rejected":
        better = _is_better(models[chosen], models[0], evidence, stages.settings.gate)
        chosen = chosen if better else 0
    state = _mapped(state, models[chosen])
    if chosen == 0:
        doubt = decision.judgements[0].verdict != "accepted"
        reasons = _with_severity(Severity.DOUBT, decision.judgements[:1])
        warnings = (Finding.of(FindingCode.NO_BETTER_MODEL), *reasons) if doubt else ()
        return ModelChange(state, match_support=_match_support(models[0]), warnings=warnings)
    return _replace(state, current, models[chosen], decision.warnings, out_dir)


def start_again(
    stages: Stages, state: GrowthState, priors: PosePriors, model_dir: Path, out_dir: Path
) -> ModelChange:
    """Map all images together, as if there were no model, and align the result with that in ``model_dir``.

    The gate judges the new models alone: a model of few images, which may be wrong, must not count against
    them. The current model stays when the gate rejects them, or when they explain fewer matches; an accepted
    one also stays when the new one is doubtful and no better.
    """
    evidence, models = _map_all(stages, state, priors)
    gate = stages.settings.gate
    decision = decide([each.judged for each in models], gate)
    current = open_colmap(model_dir)
    if decision.chosen is None:
        return ModelChange(state, warnings=_kept(FindingCode.NEW_MODEL_REJECTED, decision.judgements))
    chosen = models[decision.chosen]
    if _explained(chosen) < evidence.matches_explained(current, set(registered_names(current))):
        return ModelChange(state)
    doubtful = decision.judgements[decision.chosen]
    if doubtful.verdict != "accepted":
        before = _as_mapped(stages, current, evidence)
        (judgement,) = decide([before.judged], gate).judgements
        if judgement.verdict == "accepted" and not _is_better(chosen, before, evidence, gate):
            return ModelChange(state, warnings=_kept(FindingCode.NEW_MODEL_DOUBTFUL, (doubtful,)))
    return _replace(_mapped(state, chosen), current, chosen, decision.warnings, out_dir)


def _kept(code: FindingCode, judgements: Sequence[Judgement]) -> tuple[Finding, ...]:
    """The warning that a model of all images did not replace the current one, and the reasons."""
    return (Finding.of(code), *_with_severity(Severity.REJECTION, judgements))


def _with_severity(severity: Severity, judgements: Sequence[Judgement]) -> tuple[Finding, ...]:
    """The reasons of ``judgements`` with this severity, each once."""
    reasons: list[Finding] = []
    for reason in (reason for judgement in judgements for reason in judgement.reasons):
        found = reason.with_severity(severity)
        if found not in reasons:
            reasons.append(found)
    return tuple(reasons)


def _map_all(
    stages: Stages, state: GrowthState, priors: PosePriors
) -> tuple[ModelEvidence, list[MappedModel]]:
    """The evidence on all images, and the mappers' models."""
    stages.open(list(state.images), 2, growing=True)  # deletes the mappers' models of fewer images
    evidence = read_model_evidence(stages, priors)
    return evidence, map_images(stages, len(state.images), evidence)


def _mapped(state: GrowthState, kept: MappedModel) -> GrowthState:
    """``state`` with the number of mapped images and the match support of the model that was kept."""
    support = _match_support(kept)
    mapped_support = state.mapped_support if support is None else support
    return state.model_copy(update={"mapped_images": len(state.images), "mapped_support": mapped_support})


def _replace(
    state: GrowthState,
    current: pycolmap.Reconstruction,
    chosen: MappedModel,
    warnings: Sequence[Finding],
    out_dir: Path,
) -> ModelChange:
    """Align the ``chosen`` model with the current one and write it."""
    model, support = chosen.model, _match_support(chosen)
    try:
        alignment = align_poses(camera_poses(model), camera_poses(current))
    except InvalidInputError:
        warning = Finding.of(FindingCode.NEW_MODEL_UNALIGNED)
        return ModelChange(state, match_support=support, warnings=(warning,))
    move(model, alignment.transform)
    model.write_binary(fresh_folder(out_dir))
    names, posed = list(state.images), set(registered_names(model))
    return ModelChange(
        state.with_poses([name for name in names if name in posed], len(posed), model.num_points3D()),
        changed=True,
        mapper=chosen.judged.mapper,
        match_support=support,
        warnings=(*warnings, *model_warnings(names, chosen)),
    )


def _match_support(mapped: MappedModel) -> float | None:
    return None if mapped.judged.evidence is None else mapped.judged.evidence.match_support


def _as_mapped(stages: Stages, model: pycolmap.Reconstruction, evidence: ModelEvidence) -> MappedModel:
    centres = {name: pose.translation for name, pose in camera_poses(model).items()}
    return MappedModel(model, JudgedModel(_CURRENT, centres, evidence.of(model, stages.monitor)), ())


def _is_better(
    new: MappedModel, current: MappedModel, evidence: ModelEvidence, settings: GateSettings
) -> bool:
    """Whether the new model explains enough more matches to replace the current one.

    When the two models contradict each other, one is wrong, not necessarily that with fewer images: then only
    the matches between images of both count.
    """
    agreement = agree(current.judged, new.judged, settings)
    if agreement is not None and agreement.median_share <= settings.max_disagreement:
        return _explained(new) >= _MIN_GAIN * _explained(current)
    shared = new.judged.centres.keys() & current.judged.centres.keys()
    ours, theirs = (evidence.matches_explained(each.model, shared) for each in (new, current))
    return ours >= _MIN_GAIN * theirs


def _explained(mapped: MappedModel) -> float:
    evidence = mapped.judged.evidence
    return evidence.match_support * evidence.matches if evidence is not None else 0.0
