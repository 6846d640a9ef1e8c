"""The checks of the gate: each looks at one kind of evidence for a model and says what is wrong, or nothing.

``CHECKS`` lists them in the order in which their reasons are given. Thresholds are in ``GateSettings``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from fvs_engine.images.names import listed
from fvs_engine.sfm.report import Evidence
from fvs_engine.sfm.settings import GateSettings


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
        """Those of the images ``names`` that position priors do not confirm: those of others say nothing."""
        confirm, without = self.priors_confirm, self.evidence.images_without_prior
        return [name for name in names if not confirm or name in without]

    def are_many(self, names: Sequence[str]) -> bool:
        """Whether these images are too many to leave them out."""
        return len(names) > self.settings.max_unsupported_share * self.images


@dataclass(frozen=True)
class Check:
    """One check: ``finds`` returns a sentence about what it found in a model, None when it found nothing."""

    name: str
    weight: Weight
    finds: Callable[[Case], str | None]


def _matches_contradict(case: Case) -> str | None:
    return _few_fit(case) if case.evidence.match_support < case.settings.min_doubtful_match_support else None


def _matches_are_weak(case: Case) -> str | None:
    return _few_fit(case) if case.evidence.match_support < case.settings.min_match_support else None


def _few_fit(case: Case) -> str:
    return f"Only {case.evidence.match_support:.1%} of the verified matches fit its cameras."


def _rotations_contradict(case: Case) -> str | None:
    support = case.evidence.rotation_support
    if support is None or support >= case.settings.min_rotation_support:
        return None
    return f"Only {support:.1%} of the independent relative rotations agree with it."


def _directions_are_weak(case: Case) -> str | None:
    support = case.evidence.translation_support
    if support is None or support >= case.settings.min_translation_support:
        return None
    return f"Only {support:.1%} of the independent directions between cameras agree with it."


def _many_are_unsupported(case: Case) -> str | None:
    names = case.evidence.unsupported_images
    if not case.are_many(names) or not case.are_many(case.unconfirmed(names)):
        return None
    return _unsupported(case)


def _positions_alone_support_many(case: Case) -> str | None:
    if not case.are_many(case.evidence.unsupported_images):
        return None
    return f"{_unsupported(case)} Only their positions confirm them."


def _unsupported(case: Case) -> str:
    names = case.evidence.unsupported_images
    return f"Matches contradict the poses of {len(names)} of its {case.images} images: {listed(names)}."


def _many_are_misscaled(case: Case) -> str | None:
    names = case.evidence.misscaled_images
    return wrong_distance(names) if case.are_many(names) else None


def _some_are_misscaled(case: Case) -> str | None:
    names = case.evidence.misscaled_images
    return wrong_distance(names) if names else None


def _some_are_unscaled(case: Case) -> str | None:
    names = case.unconfirmed(case.evidence.unscaled_images)
    return unknown_distance(names) if names else None


def _many_are_misplaced(case: Case) -> str | None:
    if case.priors_are_wrong or not case.has_many_misplaced:
        return None
    names = case.evidence.misplaced_images
    return f"{len(names)} of its {case.images} images are far from their position priors: {listed(names)}."


def _centres_are_off_track(case: Case) -> str | None:
    if case.priors_are_wrong or not case.is_off_track:
        return None
    residual = case.evidence.prior_residual_share
    return f"Its camera centres are {residual:.0%} of the track off their position priors."


def _views_conflict(case: Case) -> str | None:
    pairs = [pair for pair in case.evidence.conflicting_views if case.unconfirmed(pair)]
    return two_places(pairs) if pairs else None


def _focal_length_is_unlikely(case: Case) -> str | None:
    focal_px = case.evidence.unlikely_focal_lengths_px
    if not focal_px or case.priors_confirm:
        return None
    shown = ", ".join(f"{focal:.0f}" for focal in focal_px)
    return (
        f"The estimated focal length, {shown} px, is implausible or contradicts EXIF. A flat scene seen "
        "head-on does not determine it: photograph it from the side, too, or give the camera's calibration."
    )


def _some_are_loosely_linked(case: Case) -> str | None:
    names = case.unconfirmed(case.evidence.loosely_linked_images)
    return few_matches(names) if names else None


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


def findings(case: Case) -> dict[Weight, tuple[str, ...]]:
    """What the checks find in a model, by its weight."""
    found: dict[Weight, tuple[str, ...]] = dict.fromkeys(Weight, ())
    for check in CHECKS:
        if (reason := check.finds(case)) is not None:
            found[check.weight] += (reason,)
    return found


def few_matches(names: Sequence[str]) -> str:
    """Why the poses of these images are doubtful, and the remedy."""
    return (
        f"Only a few matches connect {listed(names)} with the rest of the model. Look-alike places cause "
        "this, too; photographs taken in between would settle it."
    )


def wrong_distance(names: Sequence[str]) -> str:
    """Why the poses of these images are wrong."""
    return f"Features seen in three images contradict the distance of {listed(names)} to the other images."


def unknown_distance(names: Sequence[str]) -> str:
    """Why the poses of these images are doubtful, and the remedy."""
    return (
        f"Hardly any feature of {listed(names)} is seen in two other images, so nothing confirms the "
        "distance from the rest of the model. Take photographs in between."
    )


def two_places(pairs: Sequence[tuple[str, str]]) -> str:
    """Why the poses of pairs of images are doubtful, and the remedy."""
    shown = listed([f"{first} and {second}" for first, second in pairs])
    return (
        f"{shown} should overlap according to their poses, but large parts of them differ: two look-alike "
        "places may have been merged, or something blocked the view. Give positions, or take photographs "
        "along the way between them."
    )
