"""Registration of images in the current model of a growing reconstruction."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fvs_engine.sfm.growing.state import GrowthState, ModelChange
from fvs_engine.sfm.jobs import RegisterGuided, RegisterImages
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.stages import Stages, fresh_folder
from fvs_engine.sfm.verification.checks import few_matches, two_places, unknown_distance
from fvs_engine.sfm.warnings import doubtful, not_registered
from fvs_schema.stages import Stage


@dataclass(frozen=True)
class Unregistered:
    """Images to register, with the pose priors of all images.

    Only where the priors are ``informative`` do they confirm a pose. ``guided``: the same images, which are
    matched first, guided by their priors → the registered images that they should overlap; None for images
    with ordinary matches alone.
    """

    names: Sequence[str]
    priors: PosePriors
    informative: bool = True
    guided: Mapping[str, Sequence[str]] | None = None


def register(
    stages: Stages, state: GrowthState, images: Unregistered, model_dir: Path, out_dir: Path
) -> ModelChange:
    """Register those of the ``images`` whose matches support a pose in ``model_dir``; writes ``out_dir``.

    A pose that priors contradict is rejected, too.
    """
    names, priors = images.names, images.priors
    if not names:
        return ModelChange(state)
    settings = stages.settings
    without = [name for name in names if not images.informative or name not in priors.by_name]
    stages.monitor.report(Stage.REGISTRATION, 0, len(names))

    def ordinary(some: Sequence[str]) -> RegisterImages:
        return RegisterImages(
            database=stages.folder.database,
            image_dir=stages.image_dir,
            model_dir=model_dir,
            out_dir=fresh_folder(out_dir),
            names=tuple(some),
            refine=settings.intrinsics is None,
            lens=settings.camera_model is None,
            priors=priors,
            min_image_support=settings.growth.min_image_support,
            adjust_every=settings.growth.adjust_every,
            adjusted_images=state.adjusted_images,
            adjusted_points=state.adjusted_points,
            seed=settings.seed,
            threads=settings.threads,
        )

    def on_event(done: int) -> None:
        stages.monitor.report(Stage.REGISTRATION, min(done, len(names)), len(names))

    tried, done = tuple(names), None
    with stages.timed("registration"):
        if images.guided is None:
            done = stages.native_over(names, ordinary, on_event=on_event)
        else:
            guided, before = images.guided, tuple(state.tried_guided)
            answer = stages.native_over(
                names,
                lambda some: RegisterGuided(
                    registration=ordinary(some),
                    neighbours={name: tuple(guided[name]) for name in some if name in guided},
                    tried=before,
                ),
                on_event=on_event,
            )
            tried, done = answer.looked_at, answer.registration
    stages.monitor.report(Stage.REGISTRATION, len(names), len(names))
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
    confirmed = priors.by_name if images.informative else ()
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
