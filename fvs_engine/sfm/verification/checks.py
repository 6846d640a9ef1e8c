"""The checks of the gate: each looks at one kind of evidence for a model and finds what is wrong, or nothing.

``CHECKS`` lists them in the order in which their reasons are given. Thresholds are in ``GateSettings``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from fvs_engine.sfm.report import Evidence
from fvs_engine.sfm.settings import GateSettings
from fvs_schema.findings import Finding, FindingCode


class Weight(Enum):
    """What follows when a check finds something."""

    REJECTS = "the model is rejected"
    NEEDS_CONFIRMATION = "it is rejected, unless another mapper or GPS confirms it: then it is doubtful"
    DOUBTS = "it is doubtful"
    DOUBTS_ALONE = "it is doubtful; the reason is given where no other check found anything"


@dataclass(frozen=True, eq=False)
class Case:
    """What the checks see of a model: its evidence, the number of its images, and the thresholds."""

    evidence: Evidence
    images: int
    settings: GateSettings

    @property
    def priors_are_wrong(self) -> bool:
        """Whether not only the model but the pairs themselves contradict the position priors."""
        support = self.evidence.prior_support
        return support is not None and support < self.settings.min_prior_support

    @property
    def priors_confirm(self) -> bool:
        """Whether the position priors are evidence, and the camera centres fit them well."""
        residual = None if self.priors_are_wrong else self.evidence.prior_residual_share
        return residual is not None and residual <= self.settings.confirming_prior_share

    @property
    def contradicts_priors(self) -> bool:
        """Whether the model contradicts its position priors, be they right or wrong."""
        return self.has_many_misplaced or self.is_off_track

    @property
    def has_many_misplaced(self) -> bool:
        """Whether so many images are far from their position priors that the model or they must be wrong."""
        return len(self.evidence.misplaced_images) > self.settings.max_misplaced_share * self.images

    @property
    def is_off_track(self) -> bool:
        """Whether the camera centres as a whole are far from the position priors."""
        residual = self.evidence.prior_residual_share
        return residual is not None and residual > self.settings.max_prior_disagreement

    def unconfirmed(self, names: Sequence[str]) -> list[str]:
        """The images among ``names`` that no position prior confirms."""
        confirm, without = self.priors_confirm, self.evidence.images_without_prior
        return [name for name in names if not confirm or name in without]

    def are_many(self, names: Sequence[str]) -> bool:
        """Whether these images are too many to leave them out."""
        return len(names) > self.settings.max_unsupported_share * self.images


@dataclass(frozen=True)
class Check:
    """One check: ``finds`` returns what it found in a model, None when it found nothing."""

    name: str
    weight: Weight
    finds: Callable[[Case], Finding | None]


def _matches_contradict(case: Case) -> Finding | None:
    return _few_fit(case) if case.evidence.match_support < case.settings.min_doubtful_match_support else None


def _matches_are_weak(case: Case) -> Finding | None:
    return _few_fit(case) if case.evidence.match_support < case.settings.min_match_support else None


def _few_fit(case: Case) -> Finding:
    return Finding.of(FindingCode.MATCH_SUPPORT, support=case.evidence.match_support)


def _rotations_contradict(case: Case) -> Finding | None:
    support = case.evidence.rotation_support
    if support is None or support >= case.settings.min_rotation_support:
        return None
    return Finding.of(FindingCode.ROTATION_SUPPORT, support=support)


def _directions_are_weak(case: Case) -> Finding | None:
    support = case.evidence.translation_support
    if support is None or support >= case.settings.min_translation_support:
        return None
    return Finding.of(FindingCode.DIRECTION_SUPPORT, support=support)


def _many_are_unsupported(case: Case) -> Finding | None:
    names = case.evidence.unsupported_images
    if not case.are_many(names) or not case.are_many(case.unconfirmed(names)):
        return None
    return Finding.of(FindingCode.CONTRADICTED_POSES, names, of=case.images)


def _positions_alone_support_many(case: Case) -> Finding | None:
    names = case.evidence.unsupported_images
    if not case.are_many(names):
        return None
    return Finding.of(FindingCode.CONFIRMED_BY_POSITIONS, names, of=case.images)


def _many_are_misscaled(case: Case) -> Finding | None:
    names = case.evidence.misscaled_images
    return Finding.of(FindingCode.WRONG_DISTANCE, names) if case.are_many(names) else None


def _some_are_misscaled(case: Case) -> Finding | None:
    names = case.evidence.misscaled_images
    return Finding.of(FindingCode.WRONG_DISTANCE, names) if names else None


def _some_are_unscaled(case: Case) -> Finding | None:
    names = case.unconfirmed(case.evidence.unscaled_images)
    return Finding.of(FindingCode.UNKNOWN_DISTANCE, names) if names else None


def _many_are_misplaced(case: Case) -> Finding | None:
    if case.priors_are_wrong or not case.has_many_misplaced:
        return None
    return Finding.of(FindingCode.FAR_FROM_PRIORS, case.evidence.misplaced_images, of=case.images)


def _centres_are_off_track(case: Case) -> Finding | None:
    residual = case.evidence.prior_residual_share
    if residual is None or case.priors_are_wrong or not case.is_off_track:
        return None
    return Finding.of(FindingCode.CENTRES_OFF_PRIORS, share=residual)


def _views_conflict(case: Case) -> Finding | None:
    pairs = [pair for pair in case.evidence.conflicting_views if case.unconfirmed(pair)]
    names = [name for pair in pairs for name in pair]
    return Finding.of(FindingCode.CONFLICTING_VIEWS, names) if names else None


def _focal_length_is_unlikely(case: Case) -> Finding | None:
    focal_px = case.evidence.unlikely_focal_lengths_px
    if not focal_px or case.priors_confirm:
        return None
    shown = ", ".join(f"{focal:.0f}" for focal in focal_px)
    return Finding.of(FindingCode.UNLIKELY_FOCAL_LENGTH, focal_px=shown)


def _some_are_loosely_linked(case: Case) -> Finding | None:
    names = case.unconfirmed(case.evidence.loosely_linked_images)
    return Finding.of(FindingCode.LOOSELY_LINKED, names) if names else None


CHECKS = (
    Check("match support", Weight.REJECTS, _matches_contradict),
    Check("rotation support", Weight.REJECTS, _rotations_contradict),
    Check("unsupported images", Weight.REJECTS, _many_are_unsupported),
    Check("misscaled images", Weight.REJECTS, _many_are_misscaled),
    Check("misplaced images", Weight.REJECTS, _many_are_misplaced),
    Check("position priors", Weight.REJECTS, _centres_are_off_track),
    Check("weak match support", Weight.NEEDS_CONFIRMATION, _matches_are_weak),
    Check("translation support", Weight.NEEDS_CONFIRMATION, _directions_are_weak),
    Check("some misscaled images", Weight.DOUBTS, _some_are_misscaled),
    Check("unscaled images", Weight.DOUBTS, _some_are_unscaled),
    Check("conflicting views", Weight.DOUBTS, _views_conflict),
    Check("focal lengths", Weight.DOUBTS, _focal_length_is_unlikely),
    Check("images supported by positions", Weight.DOUBTS_ALONE, _positions_alone_support_many),
    Check("loosely linked images", Weight.DOUBTS_ALONE, _some_are_loosely_linked),
)
"""All checks of the gate, in the order of their reasons."""


def findings(case: Case) -> dict[Weight, tuple[Finding, ...]]:
    """What the checks find in a model, by its weight."""
    found: dict[Weight, tuple[Finding, ...]] = dict.fromkeys(Weight, ())
    for check in CHECKS:
        if (reason := check.finds(case)) is not None:
            found[check.weight] += (reason,)
    return found
