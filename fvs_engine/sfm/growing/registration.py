"""One update of a growing reconstruction: images registered in the current model, and a re-map when due."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pycolmap

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import align_poses
from fvs_engine.sfm.batch.mapping import MappedScene, ModelEvidence, read_model_evidence, registered_names
from fvs_engine.sfm.batch.reconstruct import map_images, model_warnings
from fvs_engine.sfm.colmap.model import camera_poses, move, open_colmap
from fvs_engine.sfm.growing.state import GrowthState
from fvs_engine.sfm.matching.witness import ask_witness
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.settings import GateSettings, SfmSettings
from fvs_engine.sfm.stages import Stages, fresh_folder
from fvs_engine.sfm.verification.gate import Candidate, agree, decide, few_matches, unknown_distance

_CURRENT = "current"
"""Used instead of a mapper's name for the grown model."""

_MIN_GAIN = 1.02
"""Factor by which a new model must explain more matches than the current one to replace it."""


@dataclass(frozen=True)
class ModelChange:
    """Result of registering images, or of a re-map.

    ``changed``: a model other than the current one was written; ``mapper`` made it, None without a re-map.
    ``match_support``: share of the verified matches that the model explains, known after a global bundle
    adjustment or a re-map.
    """

    state: GrowthState
    changed: bool = False
    mapper: str | None = None
    match_support: float | None = None
    warnings: tuple[str, ...] = ()


def register(
    stages: Stages,
    image_dir: Path,
    state: GrowthState,
    names: Sequence[str],
    priors: PosePriors,
    model_dir: Path,
    out_dir: Path,
    guided: Mapping[str, Sequence[str]] | None = None,
    *,
    informative: bool = True,
) -> ModelChange:
    """Register those of ``names`` whose matches support a pose in ``model_dir``; writes ``out_dir``.

    A pose that ``priors`` contradict is rejected, too, or one that the witness contradicts where priors are
    missing or not ``informative``. ``guided``: images to match first, guided by their priors → the registered
    images they should overlap.
    """
    if not names:
        return ModelChange(state)
    settings = stages.settings
    without = [name for name in names if not informative or name not in priors.by_name]
    asked = ask_witness(stages, image_dir, without) if without else None
    stages.monitor.report("registration", 0, len(names))
    with stages.timed("registration"):
        answer = stages.native_over(
            "register" if guided is None else "register_guided",
            names,
            lambda some: {
                **_neighbours(guided, some),
                "database": str(stages.folder.database),
                "image_dir": str(image_dir),
                "model_dir": str(model_dir),
                "out_dir": str(fresh_folder(out_dir)),
                "names": list(some),
                "refine": settings.intrinsics is None,
                "priors": priors.model_dump(mode="json"),
                "witness": None if asked is None else str(stages.folder.witness),
                "min_image_support": settings.growth.min_image_support,
                "adjust_every": settings.growth.adjust_every,
                "adjusted_images": state.adjusted_images,
                "adjusted_points": state.adjusted_points,
                "seed": settings.seed,
                "threads": settings.threads,
            },
            on_event=lambda done: stages.monitor.report("registration", min(done, len(names)), len(names)),
        )
    stages.monitor.report("registration", len(names), len(names))
    if answer is None:  # nothing could be guided
        return ModelChange(state)
    posed = set(answer["posed"])
    lost = [name for name in state.registered if name not in posed]
    warnings = [
        not_registered(name, reason)
        for name, reason in answer["rejected"].items()
        if name not in state.rejected
    ]
    if lost:
        warnings.append(f"Global bundle adjustment left {', '.join(lost)} without a pose.")
    loose = [name for name in answer["loose"] if name in without]
    if loose:
        warnings.append(f"DOUBTFUL CAMERAS: {few_matches(loose)}")
    if unscaled := [name for name in answer["unscaled"] if name in without]:
        warnings.append(f"DOUBTFUL CAMERAS: {unknown_distance(unscaled)}")
    support = answer["match_support"]
    if support is not None and support < settings.gate.min_match_support:
        warnings.append(f"DOUBTFUL CAMERAS: {support:.1%} of the verified matches fit them.")
    kept = [name for name in state.registered if name in posed]
    state = state.model_copy(update={"rejected": state.rejected | answer["rejected"]})
    return ModelChange(
        state.with_poses(
            [*kept, *answer["registered"]], answer["adjusted_images"], answer["adjusted_points"]
        ),
        changed=bool(answer["registered"] or lost or support is not None),
        match_support=support,
        warnings=tuple(warnings),
    )


def not_registered(name: str, reason: str) -> str:
    """The warning that an image was matched and has no pose, and the remedy."""
    return f"{name} is not registered: {reason}. Photographs from between it and the others would show why."


def _neighbours(guided: Mapping[str, Sequence[str]] | None, names: Sequence[str]) -> dict[str, Any]:
    """The neighbours of ``names``, as an argument of the native job."""
    if guided is None:
        return {}
    return {"neighbours": {name: list(guided[name]) for name in names if name in guided}}


def reason_to_remap(
    state: GrowthState, match_support: float | None, unregistered: int, settings: SfmSettings
) -> str | None:
    """Why a re-map is due, None if it is not.

    ``unregistered`` counts the images that match registered ones and have no pose. A re-map costs as much as
    a new reconstruction, less features and matches: it is not repeated before the images have grown by a
    share.
    """
    growth = settings.growth
    if len(state.images) < (1.0 + growth.remap_every) * state.mapped_images:
        return None
    if match_support is not None and match_support < state.mapped_support - growth.max_support_loss:
        return f"Match support fell from {state.mapped_support:.1%} to {match_support:.1%}."
    if unregistered > 0 and unregistered >= growth.max_unregistered * len(state.registered):
        return f"{unregistered} images that match registered ones are unregistered."
    return None


def remap(
    stages: Stages,
    image_dir: Path,
    state: GrowthState,
    priors: PosePriors,
    model_dir: Path,
    out_dir: Path,
) -> ModelChange:
    """Run the mappers again on all images; the gate chooses between their models and that in ``model_dir``.

    A new model that is chosen is aligned with the current one and written to ``out_dir``.
    """
    names, evidence, mapped = _map_all(stages, image_dir, state, priors)
    current = open_colmap(model_dir)
    scenes = [_as_scene(stages, current, evidence), *mapped]
    decision = decide([scene.candidate for scene in scenes], stages.settings.gate)
    chosen = decision.chosen or 0
    if chosen > 0 and decision.judgements[0].verdict != "rejected":
        better = _is_better(scenes[chosen], scenes[0], evidence, stages.settings.gate)
        chosen = chosen if better else 0
    state = _mapped(state, scenes[chosen])
    if chosen == 0:
        reasons = " ".join(decision.judgements[0].reasons)
        doubt = decision.judgements[0].verdict != "accepted"
        warnings = (f"The re-map found no better model. DOUBTFUL CAMERAS: {reasons}",) if doubt else ()
        return ModelChange(state, match_support=_match_support(scenes[0]), warnings=warnings)
    return _replace(state, current, scenes[chosen], names, decision.warnings, out_dir)


def start_again(
    stages: Stages,
    image_dir: Path,
    state: GrowthState,
    priors: PosePriors,
    model_dir: Path,
    out_dir: Path,
) -> ModelChange:
    """Map all images together, as if there were no model, and align the result with that in ``model_dir``.

    The gate judges the new models alone: a model of few images, which may be wrong, must not count against
    them. The current model stays when the gate rejects them, or when they explain fewer matches; an accepted
    one also stays when the new one is doubtful and no better.
    """
    names, evidence, scenes = _map_all(stages, image_dir, state, priors)
    gate = stages.settings.gate
    decision = decide([scene.candidate for scene in scenes], gate)
    current = open_colmap(model_dir)
    if decision.chosen is None:
        return ModelChange(state)
    chosen = scenes[decision.chosen]
    if _explained(chosen) < evidence.matches_explained(current, set(registered_names(current))):
        return ModelChange(state)
    if decision.judgements[decision.chosen].verdict != "accepted":
        before = _as_scene(stages, current, evidence)
        (judgement,) = decide([before.candidate], gate).judgements
        if judgement.verdict == "accepted" and not _is_better(chosen, before, evidence, gate):
            return ModelChange(state)
    return _replace(_mapped(state, chosen), current, chosen, names, decision.warnings, out_dir)


def _map_all(
    stages: Stages, image_dir: Path, state: GrowthState, priors: PosePriors
) -> tuple[list[str], ModelEvidence, list[MappedScene]]:
    """The images' names, the evidence on them, and the mappers' models."""
    names = stages.open(
        image_dir, list(state.images), 2, growing=True
    )  # deletes the mappers' models of fewer images
    evidence = read_model_evidence(stages, priors, image_dir)
    return names, evidence, map_images(stages, image_dir, len(names), evidence)


def _mapped(state: GrowthState, kept: MappedScene) -> GrowthState:
    """``state`` with the number of mapped images and the match support of the model that was kept."""
    support = _match_support(kept)
    mapped_support = state.mapped_support if support is None else support
    return state.model_copy(update={"mapped_images": len(state.images), "mapped_support": mapped_support})


def _replace(
    state: GrowthState,
    current: pycolmap.Reconstruction,
    chosen: MappedScene,
    names: Sequence[str],
    warnings: Sequence[str],
    out_dir: Path,
) -> ModelChange:
    """Align the ``chosen`` model with the current one and write it."""
    model, support = chosen.model, _match_support(chosen)
    try:
        alignment = align_poses(camera_poses(model), camera_poses(current))
    except InvalidInputError:
        warning = "A model of all images shares too few cameras with the current one to be aligned with it."
        return ModelChange(state, match_support=support, warnings=(warning,))
    move(model, alignment)
    model.write_binary(fresh_folder(out_dir))
    posed = set(registered_names(model))
    return ModelChange(
        state.with_poses([name for name in names if name in posed], len(posed), model.num_points3D()),
        changed=True,
        mapper=chosen.candidate.mapper,
        match_support=support,
        warnings=(*warnings, *model_warnings(names, chosen)),
    )


def _match_support(scene: MappedScene) -> float | None:
    return None if scene.candidate.evidence is None else scene.candidate.evidence.match_support


def _as_scene(stages: Stages, model: pycolmap.Reconstruction, evidence: ModelEvidence) -> MappedScene:
    centres = {name: pose.translation for name, pose in camera_poses(model).items()}
    return MappedScene(model, Candidate(_CURRENT, centres, evidence.of(model, stages.monitor)), ())


def _is_better(
    new: MappedScene, current: MappedScene, evidence: ModelEvidence, settings: GateSettings
) -> bool:
    """Whether the new model explains enough more matches to replace the current one.

    When the two models contradict each other, one is wrong, not necessarily that with fewer images: then only
    the matches between images of both count.
    """
    agreement = agree(current.candidate, new.candidate)
    if agreement is not None and agreement.median_share <= settings.max_disagreement:
        return _explained(new) >= _MIN_GAIN * _explained(current)
    shared = new.candidate.centres.keys() & current.candidate.centres.keys()
    ours, theirs = (evidence.matches_explained(scene.model, shared) for scene in (new, current))
    return ours >= _MIN_GAIN * theirs


def _explained(scene: MappedScene) -> float:
    evidence = scene.candidate.evidence
    return evidence.match_support * evidence.matches if evidence is not None else 0.0
