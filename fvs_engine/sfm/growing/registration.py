"""One step of growth: images registered into the standing model, all cameras found anew when need be."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pycolmap

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import align_poses
from fvs_engine.sfm.batch.mapping import MappedScene, Witnesses, read_witnesses, registered_names
from fvs_engine.sfm.batch.reconstruct import map_images
from fvs_engine.sfm.colmap.model import camera_poses, move, open_colmap
from fvs_engine.sfm.growing.state import GrowthState
from fvs_engine.sfm.settings import GateSettings, SfmSettings
from fvs_engine.sfm.stages import Stages, fresh_folder
from fvs_engine.sfm.verification.gate import Candidate, Decision, decide
from fvs_engine.sfm.verification.positions import Positions

_STANDING = "standing"
"""In the place of a mapper's name: the model that grew."""

_MIN_WAITING = 3
"""Fewer waiting images are no reason to find all cameras anew."""

_MIN_GAIN = 1.02
"""A new model must explain so many times the matches of the standing one to take its place."""


@dataclass(frozen=True)
class Registration:
    """What became of the images; ``support`` is known when all cameras were ``adjusted``."""

    state: GrowthState
    changed: bool
    adjusted: bool
    support: float | None
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Remapping:
    """Whether the cameras that were found anew took the place of the standing ones."""

    state: GrowthState
    adopted: bool
    warnings: tuple[str, ...]


def register(
    stages: Stages,
    image_dir: Path,
    state: GrowthState,
    names: Sequence[str],
    positions: Positions,
    model_dir: Path,
    out_dir: Path,
) -> Registration:
    """Register those of ``names`` whose matches support a place in the model; it goes to ``out_dir``.

    A place that contradicts ``positions`` does not count either.
    """
    if not names:
        return Registration(state, changed=False, adjusted=False, support=None, warnings=())
    settings = stages.settings
    stages.monitor.report("registration", 0, len(names))
    with stages.timed("registration"):
        answer = stages.native(
            "grow",
            {
                "database": str(stages.folder.database),
                "image_dir": str(image_dir),
                "model_dir": str(model_dir),
                "out_dir": str(fresh_folder(out_dir)),
                "names": list(names),
                "refine": settings.intrinsics is None,
                "positions": positions.to_json(),
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
    posed = set(answer["posed"])
    registered = (*(name for name in state.registered if name in posed), *answer["registered"])
    lost = [name for name in state.registered if name not in posed]
    warnings = [
        f"{name} is not taken in: {reason}. It waits."
        for name, reason in answer["refused"].items()
        if name not in state.refused
    ]
    if lost:
        warnings.append(f"{', '.join(lost)} lost their cameras when all were adjusted; they wait.")
    if answer["support"] is not None and answer["support"] < settings.gate.min_match_support:
        warnings.append(f"DOUBTFUL CAMERAS: {answer['support']:.1%} of the verified matches fit them.")
    adjusted = answer["support"] is not None
    return Registration(
        state.model_copy(
            update={
                "registered": registered,
                "refused": {
                    name: why
                    for name, why in {**state.refused, **answer["refused"]}.items()
                    if name not in posed
                },
                "adjusted_images": answer["adjusted_images"],
                "adjusted_points": answer["adjusted_points"],
            }
        ),
        changed=bool(answer["registered"]),
        adjusted=adjusted,
        support=answer["support"],
        warnings=tuple(warnings),
    )


def reason_to_remap(
    state: GrowthState, support: float | None, waiting: int, settings: SfmSettings
) -> str | None:
    """Why all cameras should be found anew, None if they should not.

    ``waiting`` counts the images that match registered ones and have no camera. An attempt costs as much as
    starting again, less features and matches: it is not repeated before the images have grown by a share.
    """
    growth = settings.growth
    if len(state.images) < (1.0 + growth.remap_every) * state.mapped_images:
        return None
    if support is not None and support < state.mapped_support - growth.max_support_loss:
        return f"The matches that the cameras explain fell from {state.mapped_support:.1%} to {support:.1%}."
    if waiting >= max(_MIN_WAITING, growth.max_waiting * len(state.registered)):
        return f"{waiting} images that match the registered ones wait."
    return None


def remap(
    stages: Stages,
    image_dir: Path,
    state: GrowthState,
    positions: Positions,
    model_dir: Path,
    out_dir: Path,
) -> Remapping:
    """Find all cameras anew from the matches at hand; the gate weighs them against the standing model.

    A model that takes its place is laid onto it and written to ``out_dir``.
    """
    names = list(state.images)
    stages.open(image_dir, names, 2)  # forgets the mappers' models of fewer images
    witnesses = read_witnesses(stages, positions)
    standing = open_colmap(model_dir)
    scenes = [
        _weigh_standing(stages, standing, witnesses),
        *map_images(stages, image_dir, len(names), witnesses),
    ]
    decision = decide([scene.candidate for scene in scenes], stages.settings.gate)
    chosen = decision.chosen or 0
    if chosen > 0 and decision.judgements[0].verdict != "refused":
        better = _is_better(scenes[chosen], scenes[0], decision, witnesses, stages.settings.gate)
        chosen = chosen if better else 0
    update: dict[str, object] = {"mapped_images": len(names)}
    evidence = scenes[chosen].candidate.evidence
    if evidence is not None:
        update["mapped_support"] = evidence.match_support
    if chosen == 0:
        reasons = " ".join(decision.judgements[0].reasons)
        doubt = decision.judgements[0].verdict != "accepted"
        warnings = (f"No better cameras were found. DOUBTFUL CAMERAS: {reasons}",) if doubt else ()
        return Remapping(state.model_copy(update=update), adopted=False, warnings=warnings)
    model = scenes[chosen].model
    try:
        alignment = align_poses(camera_poses(model), camera_poses(standing))
    except InvalidInputError:
        warning = "The cameras that were found anew share too little with the standing ones to replace them."
        return Remapping(state.model_copy(update=update), adopted=False, warnings=(warning,))
    move(model, alignment)
    model.write_binary(fresh_folder(out_dir))
    posed = set(registered_names(model))
    before = set(state.registered)
    update |= {
        "registered": (
            *(name for name in state.registered if name in posed),
            *(name for name in names if name in posed - before),
        ),
        "refused": {name: why for name, why in state.refused.items() if name not in posed},
        "adjusted_images": len(posed),
        "adjusted_points": model.num_points3D(),
    }
    mapper = scenes[chosen].candidate.mapper
    warning = f"All cameras were found anew by {mapper} mapping and laid onto those that stood."
    return Remapping(state.model_copy(update=update), adopted=True, warnings=(warning, *decision.warnings))


def _weigh_standing(stages: Stages, model: pycolmap.Reconstruction, witnesses: Witnesses) -> MappedScene:
    centres = {name: pose.translation for name, pose in camera_poses(model).items()}
    return MappedScene(model, Candidate(_STANDING, centres, witnesses.testify(model, stages.monitor)), ())


def _is_better(
    new: MappedScene, standing: MappedScene, decision: Decision, witnesses: Witnesses, settings: GateSettings
) -> bool:
    """Whether the new model explains so many more matches that it is worth moving all cameras.

    One of two models that contradict each other is wrong, and that one of them has more images does not make
    it the right one: then only the matches between images of both count.
    """
    mappers = {new.candidate.mapper, standing.candidate.mapper}
    agreement = next((found for found in decision.agreements if set(found.mappers) == mappers), None)
    if agreement is not None and agreement.median_share <= settings.max_disagreement:
        return _explained(new) >= _MIN_GAIN * _explained(standing)
    shared = new.candidate.centres.keys() & standing.candidate.centres.keys()
    ours, theirs = (witnesses.matches_explained(scene.model, shared) for scene in (new, standing))
    return ours >= _MIN_GAIN * theirs


def _explained(scene: MappedScene) -> float:
    evidence = scene.candidate.evidence
    return evidence.match_support * evidence.matches if evidence is not None else 0.0
