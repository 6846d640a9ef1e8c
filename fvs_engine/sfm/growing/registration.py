"""Registration of images in the current model of a growing reconstruction."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fvs_engine.sfm.answers import GuidedRegistration
from fvs_engine.sfm.growing.model_change import ModelChange
from fvs_engine.sfm.growing.state import GrowthState
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.stages import Stages, fresh_folder
from fvs_engine.sfm.verification.gate import few_matches, two_places, unknown_distance
from fvs_engine.sfm.warnings import doubtful, not_registered
from fvs_schema.stages import Stage


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

    A pose that ``priors`` contradict is rejected, too; only where they are ``informative`` do they confirm
    one. ``guided``: images to match first, guided by their priors → the registered images they should
    overlap.
    """
    if not names:
        return ModelChange(state)
    settings = stages.settings
    without = [name for name in names if not informative or name not in priors.by_name]
    stages.monitor.report(Stage.REGISTRATION, 0, len(names))
    with stages.timed("registration"):
        answer = stages.native_over(
            "register" if guided is None else "register_guided",
            names,
            lambda some: {
                **_guided(guided, some, state),
                "database": str(stages.folder.database),
                "image_dir": str(image_dir),
                "model_dir": str(model_dir),
                "out_dir": str(fresh_folder(out_dir)),
                "names": list(some),
                "refine": settings.intrinsics is None,
                "lens": settings.camera_model is None,
                "priors": priors.model_dump(mode="json"),
                "min_image_support": settings.growth.min_image_support,
                "adjust_every": settings.growth.adjust_every,
                "adjusted_images": state.adjusted_images,
                "adjusted_points": state.adjusted_points,
                "seed": settings.seed,
                "threads": settings.threads,
            },
            on_event=lambda done: stages.monitor.report(
                Stage.REGISTRATION, min(done, len(names)), len(names)
            ),
        )
    stages.monitor.report(Stage.REGISTRATION, len(names), len(names))
    answered = (
        GuidedRegistration(looked_at=names, registration=answer)
        if guided is None
        else GuidedRegistration.model_validate(answer)
    )
    tried, done = answered.looked_at, answered.registration
    if done is None:  # nothing could be guided
        return ModelChange(state, tried=tried)
    posed = set(done.posed)
    lost = [name for name in state.registered if name not in posed]
    warnings = [
        not_registered(name, reason) for name, reason in done.rejected.items() if name not in state.rejected
    ]
    if lost:
        warnings.append(f"Global bundle adjustment left {', '.join(lost)} without a pose.")
    loose = [name for name in done.loose if name in without]
    if loose:
        warnings.append(doubtful(few_matches(loose)))
    if unscaled := [name for name in done.unscaled if name in without]:
        warnings.append(doubtful(unknown_distance(unscaled)))
    confirmed = priors.by_name if informative else ()
    if conflicting := [pair for pair in done.conflicting if not all(name in confirmed for name in pair)]:
        warnings.append(doubtful(two_places(conflicting)))
    support = done.match_support
    if support is not None and support < settings.gate.min_match_support:
        warnings.append(doubtful(f"{support:.1%} of the verified matches fit them."))
    kept = [name for name in state.registered if name in posed]
    state = state.model_copy(update={"rejected": state.rejected | done.rejected})
    return ModelChange(
        state.with_poses([*kept, *done.registered], done.adjusted_images, done.adjusted_points),
        changed=bool(done.registered or lost or support is not None),
        match_support=support,
        warnings=tuple(warnings),
        tried=tried,
    )


def _guided(
    guided: Mapping[str, Sequence[str]] | None, names: Sequence[str], state: GrowthState
) -> dict[str, Any]:
    """What the native job of guided matches needs besides."""
    if guided is None:
        return {}
    neighbours = {name: list(guided[name]) for name in names if name in guided}
    return {"neighbours": neighbours, "tried": list(state.tried_guided)}
