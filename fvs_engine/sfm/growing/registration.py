"""Registration of images in the current model of a growing reconstruction."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fvs_engine.sfm.growing.state import GrowthState, ModelChange
from fvs_engine.sfm.jobs import RegisterGuided, RegisterImages
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.stages import Stages, fresh_folder
from fvs_schema.findings import Finding, FindingCode, Severity
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
    warnings = [finding for name, finding in done.rejected.items() if name not in state.rejected]
    if lost:
        warnings.append(Finding.of(FindingCode.POSES_LOST, lost))
    confirmed = priors.by_name if images.informative else ()
    pairs = [pair for pair in done.conflicting if not all(name in confirmed for name in pair)]
    for code, doubted in (
        (FindingCode.LOOSELY_LINKED, [name for name in done.loose if name in without]),
        (FindingCode.UNKNOWN_DISTANCE, [name for name in done.unscaled if name in without]),
        (FindingCode.CONFLICTING_VIEWS, [name for pair in pairs for name in pair]),
    ):
        if doubted:
            warnings.append(Finding.of(code, doubted, Severity.DOUBT))
    support = done.match_support
    if support is not None and support < settings.gate.min_match_support:
        warnings.append(Finding.of(FindingCode.MATCH_SUPPORT, severity=Severity.DOUBT, support=support))
    kept = [name for name in state.registered if name in posed]
    state = state.model_copy(update={"rejected": state.rejected | done.rejected})
    return ModelChange(
        state.with_poses([*kept, *done.registered], done.adjusted_images, done.adjusted_points),
        changed=bool(done.registered or lost or support is not None),
        match_support=support,
        warnings=tuple(warnings),
        tried=tried,
    )
