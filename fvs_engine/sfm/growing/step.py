"""One step of a growing reconstruction: matching, registration and, when due, a re-map of all images."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fvs_engine.sfm.colmap.database import image_cameras, verified_matches
from fvs_engine.sfm.colmap.guided_pairs import take_back_guided_pairs
from fvs_engine.sfm.growing.guided import guide
from fvs_engine.sfm.growing.neighbours import Surroundings, match_with_neighbours
from fvs_engine.sfm.growing.overlap import predicted_neighbours
from fvs_engine.sfm.growing.prior_veto import Veto, veto
from fvs_engine.sfm.growing.registration import Unregistered, register
from fvs_engine.sfm.growing.registration_inputs import RegistrationInputs, matches_of
from fvs_engine.sfm.growing.remap import reason_to_remap, remap, start_again
from fvs_engine.sfm.growing.state import GrowthFolder, GrowthState, ModelChange
from fvs_engine.sfm.matching.match import match_features
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.settings import GrowthSettings
from fvs_engine.sfm.stages import Stages
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES
from fvs_engine.sfm.verification.positions import usable_priors
from fvs_engine.sfm.warnings import without_doubts, without_registered
from fvs_schema.findings import Finding, FindingCode, Severity

_MANY_NEW, _MANY_NEW_SHARE = 5, 0.5
"""Number of new images, and ratio of new to registered ones, from which all images are mapped together."""


@dataclass(frozen=True)
class Step:
    """The state after a step, to be committed.

    ``changed``: the folder's next model is the new one; ``from_all``: it was made of all images together;
    ``replaced``: its cameras are a mapper's, not those of the model before.
    """

    state: GrowthState
    changed: bool
    warnings: tuple[Finding, ...]
    from_all: bool = False
    replaced: bool = False


def step(
    stages: Stages, folder: GrowthFolder, state: GrowthState, around: Surroundings, given: PosePriors | None
) -> Step:
    """Register those of the images ``around``, all with features, that have no pose in the current model.

    ``given``: pose priors, see ``GrowingReconstruction.add``.
    """
    database, model_dir, following = stages.folder.database, folder.model(state.generation), folder.next_model
    usable, with_features = around.earlier, set(around.earlier)
    unregistered = [name for name in state.unregistered if name in with_features]
    take_back_guided_pairs(database, state.registered)
    priors, frozen = usable_priors(given, database)
    if len(state.pending) >= max(_MANY_NEW, _MANY_NEW_SHARE * len(state.registered)):
        match_features(stages, usable, given)
        decided = veto(stages, model_dir, unregistered, priors)
        change = start_again(stages, state, decided.priors, model_dir, following)
        if change.changed:
            return _from_all(stages, state, change, (*frozen, *decided.ignored))
        stages.warnings.extend(change.warnings)
    matched = _match(stages, unregistered, around, priors)
    decided = veto(stages, model_dir, matched, priors)
    change = _register_due(stages, folder, state, matched, decided)
    change = guide(stages, folder, change, usable, decided.priors)
    change = _remap_if_due(stages, folder, change, decided.priors)
    ignored = (*frozen, *decided.ignored)
    warnings = [*stages.warnings, *_news(ignored, state), *change.warnings]
    named = {name for finding in warnings for name in finding.images}
    unnamed = [name for name in state.pending if name in with_features and name not in named]
    warnings += _unregistered(unnamed, matched, change.state)
    state = change.state.model_copy(update={"pending": (), "priors_ignored": ignored})
    return Step(
        state,
        change.changed,
        without_registered(warnings, state.registered),
        replaced=change.mapper is not None,
    )


def _register_due(
    stages: Stages, folder: GrowthFolder, state: GrowthState, matched: Sequence[str], decided: Veto
) -> ModelChange:
    """Register those of the ``matched`` images that were not tried with the same inputs before."""
    database, model_dir = stages.folder.database, folder.model(state.generation)
    matches = matches_of(matched, verified_matches(database, MIN_PAIR_MATCHES))
    inputs = RegistrationInputs(
        model_dir, matches, image_cameras(database), decided.priors, informative=decided.informative
    )
    due = inputs.due(state.tried)
    if due and _adjusts_all(state, len(due), stages.settings.growth):
        due = list(matches)  # the adjustment changes the inputs of all
    change = register(
        stages,
        state.model_copy(update={"rejected": state.rejected | decided.without_pairs}),
        Unregistered(due, decided.priors, decided.informative),
        model_dir,
        folder.next_model,
    )
    left = set(change.state.unregistered)
    tried = {name: inputs.of(name) for name in change.tried if name in left}
    without_pairs = (finding for name, finding in decided.without_pairs.items() if name not in state.rejected)
    change = replace(change, warnings=(*without_pairs, *change.warnings))
    return change.with_state(tried=change.state.tried | tried)


def _remap_if_due(
    stages: Stages, folder: GrowthFolder, change: ModelChange, priors: PosePriors
) -> ModelChange:
    """Map all images again if that is due after ``change``; both changes in one, with their warnings."""
    matching = _count_matching_unregistered(stages.folder.database, change.state)
    reason = reason_to_remap(change.state, change.match_support, matching, stages.settings)
    if reason is None:
        return change
    grown = folder.next_model if change.changed else folder.model(change.state.generation)
    remapped = remap(stages, change.state, priors, grown, folder.next_model)
    if remapped.mapper is None:
        warnings = (*change.warnings, *((reason, *remapped.warnings) if remapped.warnings else ()))
    else:
        done = Finding.of(FindingCode.REMAPPED, severity=Severity.NOTE, mapper=remapped.mapper)
        warnings = (*without_doubts(change.warnings), reason, done, *remapped.warnings)
    return replace(remapped, changed=change.changed or remapped.changed, warnings=warnings)


def _adjusts_all(state: GrowthState, new: int, settings: GrowthSettings) -> bool:
    """Whether bundle adjustment of all images is due once ``new`` ones are registered.

    It may also become due by new points, which is not known before.
    """
    return len(state.registered) + new >= (1.0 + settings.adjust_every) * state.adjusted_images


def _from_all(stages: Stages, before: GrowthState, change: ModelChange, ignored: tuple[Finding, ...]) -> Step:
    """The step to a model that was made of all images together."""
    update = {"pending": (), "priors_ignored": ignored, "bootstrap_images": len(change.state.images)}
    return Step(
        change.state.model_copy(update=update),
        changed=True,
        warnings=(*_news(ignored, before), *stages.warnings, *change.warnings),
        from_all=True,
        replaced=True,
    )


def _news(ignored: Iterable[Finding], before: GrowthState) -> list[Finding]:
    """The findings about ``ignored`` priors whose kind the update ``before`` did not have."""
    known = {finding.code for finding in before.priors_ignored}
    return [finding for finding in ignored if finding.code not in known]


def _unregistered(new: Sequence[str], matched: Sequence[str], state: GrowthState) -> list[Finding]:
    """Why those of the ``new`` images without a pose have none."""
    left = [name for name in new if name in set(state.unregistered)]
    unmatched = tuple(name for name in left if name not in matched)
    few = tuple(name for name in left if name in matched)
    found = ((FindingCode.UNMATCHED, unmatched), (FindingCode.FEW_POINTS, few))
    return [Finding.of(code, images) for code, images in found if images]


def _match(
    stages: Stages, unregistered: Sequence[str], around: Surroundings, priors: PosePriors
) -> list[str]:
    """Match the ``unregistered`` images; returns those that match anything."""
    predicted = predicted_neighbours(unregistered, priors, around.model)
    match_with_neighbours(stages, unregistered, around, predicted=predicted)
    pairs = verified_matches(stages.folder.database, MIN_PAIR_MATCHES)
    matched = {name for pair in pairs for name in pair}
    return [name for name in unregistered if name in matched]


def _count_matching_unregistered(database: Path, state: GrowthState) -> int:
    """The number of unregistered images that match registered ones."""
    unregistered, registered = set(state.unregistered), set(state.registered)
    pairs = verified_matches(database, MIN_PAIR_MATCHES)
    return len({a for pair in pairs for a, b in (pair, pair[::-1]) if a in unregistered and b in registered})
