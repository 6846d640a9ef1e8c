"""The gate: choice of the model by evidence that a wrong one lacks, not by its number of images.

See ``docs/design/gate.md`` for the measurements behind the thresholds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.positions import MAX_MISPLACED_SHARE
from fvs_engine.geometry.alignment.similarity import umeyama
from fvs_engine.images.names import listed
from fvs_engine.sfm.report import Agreement, Evidence, Verdict
from fvs_engine.sfm.settings import GateSettings
from fvs_engine.sfm.warnings import doubtful

MIN_SHARED_IMAGES = 4
"""Three centres always fit well; agreement is significant from four on."""

MAX_UNSUPPORTED_SHARE = 0.1
"""Up to this share of a model's images unsupported ones are removed, above it the model is rejected."""

MIN_PRIOR_SUPPORT = 0.6
"""Share of the pairs whose baselines must fit the position priors for these to be evidence."""

PRIORS_IGNORED = (
    "The position priors contradict the images and are not used: the baselines between matched images do "
    "not fit them. Check their units and axes, and whether they belong to these images."
)

_CONFIRMING_PRIOR_SHARE = 0.1
"""Median distance to GPS, in shares of the track's spread, up to which GPS confirms a doubtful model."""

_DOUBT = 0.5
"""A doubtful model must explain twice the matches of an accepted one to be preferred to it."""

_CLOSE_SUPPORT = 0.01
"""Match support that differs by less does not decide between two models."""


@dataclass(frozen=True, eq=False)
class JudgedModel:
    """Input of the gate for one model: camera centres by image name, and evidence."""

    mapper: str
    centres: Mapping[str, NDArray[np.float64]]
    evidence: Evidence | None


@dataclass(frozen=True)
class Judgement:
    """The verdict on one model, and the reasons."""

    verdict: Verdict
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Decision:
    """``chosen`` indexes the models, None when all are rejected."""

    chosen: int | None
    judgements: tuple[Judgement, ...]
    agreements: tuple[Agreement, ...]
    warnings: tuple[str, ...]


def decide(models: Sequence[JudgedModel], settings: GateSettings) -> Decision:
    """Judge every model and choose the best supported one that is not rejected.

    A model is accepted on its own evidence. One with slightly too little evidence is doubtful (usable with a
    warning) if another mapper or GPS agrees with it: a repeated pattern rarely causes the same errors in
    both. One with loosely linked images, with distances that no features seen in three images determine, or
    with conflicting views, is doubtful unless GPS confirms it. Among accepted ones that disagree, the better
    supported is chosen; a tie makes it doubtful.
    """
    agreements = tuple(
        agreement
        for i, first in enumerate(models)
        for second in models[i + 1 :]
        if (agreement := agree(first, second)) is not None
    )
    judgements = [_judge(model, agreements, settings) for model in models]
    usable = [i for i, judgement in enumerate(judgements) if judgement.verdict != "rejected"]
    if not usable:
        return Decision(None, tuple(judgements), agreements, ())
    best = max(usable, key=lambda i: _rank(models[i], judgements[i]))
    warnings = []
    evidence = models[best].evidence
    if evidence is not None and priors_are_wrong(evidence):
        warnings.append(PRIORS_IGNORED)
    as_good = [models[i] for i in usable if judgements[i].verdict == judgements[best].verdict]
    rival = next((model for model in as_good if _rivals(model, models[best], agreements, settings)), None)
    if rival is not None:
        reason = (
            f"The {rival.mapper} mapper found another model that the matches support as well; "
            "at least one of them is wrong."
        )
        judgements[best] = Judgement("doubtful", (*judgements[best].reasons, reason))
    if judgements[best].verdict == "doubtful":
        warnings.append(doubtful(f"{' '.join(judgements[best].reasons)} Look at the result before use."))
    return Decision(best, tuple(judgements), agreements, tuple(warnings))


def agree(first: JudgedModel, second: JudgedModel) -> Agreement | None:
    """How far two models' camera centres are apart after Umeyama; None when too few are shared."""
    shared = sorted(first.centres.keys() & second.centres.keys())
    if len(shared) < MIN_SHARED_IMAGES:
        return None
    source = np.stack([first.centres[name] for name in shared])
    target = np.stack([second.centres[name] for name in shared])
    try:
        second_from_first = umeyama(source, target)
    except InvalidInputError:  # all centres coincide
        return None
    shares = np.linalg.norm(second_from_first.apply(source) - target, axis=1) / centre_spread(target)
    return Agreement(
        mappers=(first.mapper, second.mapper),
        shared_images=len(shared),
        median_share=float(np.median(shares)),
        max_share=float(shares.max()),
    )


def _judge(model: JudgedModel, agreements: Sequence[Agreement], settings: GateSettings) -> Judgement:
    evidence = model.evidence
    if evidence is None:
        return Judgement("rejected", ("It has no verified pair of images.",))
    support = f"{evidence.match_support:.1%} of the verified matches fit its cameras."
    rejections = []
    if evidence.match_support < settings.min_doubtful_match_support:
        rejections.append(f"Only {support}")
    if evidence.rotation_support is not None and evidence.rotation_support < settings.min_rotation_support:
        rejections.append(
            f"Only {evidence.rotation_support:.1%} of the independent relative rotations agree with it."
        )
    images = len(model.centres)
    unsupported = evidence.unsupported_images
    many_unsupported = len(unsupported) > MAX_UNSUPPORTED_SHARE * images
    unsupported_shown = f"Matches contradict the poses of {_counted(unsupported, images)}."
    if many_unsupported and len(_unconfirmed(evidence, unsupported)) > MAX_UNSUPPORTED_SHARE * images:
        rejections.append(unsupported_shown)
    misscaled = evidence.misscaled_images
    if len(misscaled) > MAX_UNSUPPORTED_SHARE * images:
        rejections.append(wrong_distance(misscaled))
    if not priors_are_wrong(evidence):
        rejections += contradictions_of_priors(evidence, images, settings)
    if rejections:
        return Judgement("rejected", tuple(rejections))
    doubts = _doubts_beyond_pairs(evidence)
    weaknesses = _weaknesses(evidence, settings)
    confirmation = _confirmation(model.mapper, evidence, agreements, settings)
    if weaknesses and confirmation is None:
        return Judgement("rejected", (*weaknesses, "Neither another mapper nor GPS confirms it."))
    if weaknesses:
        return Judgement("doubtful", (*weaknesses, f"But {confirmation} it.", *doubts))
    if doubts:
        return Judgement("doubtful", doubts)
    if many_unsupported:
        return Judgement("doubtful", (f"{unsupported_shown} Only their positions confirm them.",))
    if loose := _unconfirmed(evidence, evidence.loosely_linked_images):
        return Judgement("doubtful", (few_matches(loose),))
    return Judgement("accepted", (support,))


def _counted(names: Sequence[str], images: int) -> str:
    """These images of a model, for a reason."""
    return f"{len(names)} of its {images} images: {listed(names)}"


def _weaknesses(evidence: Evidence, settings: GateSettings) -> list[str]:
    """What must be confirmed by another mapper or GPS."""
    found = []
    if evidence.match_support < settings.min_match_support:
        found.append(f"Only {evidence.match_support:.1%} of the verified matches fit its cameras.")
    directions = evidence.translation_support
    if directions is not None and directions < settings.min_translation_support:
        found.append(f"Only {directions:.1%} of the independent directions between cameras agree with it.")
    return found


def _doubts_beyond_pairs(evidence: Evidence) -> tuple[str, ...]:
    """Doubts that no pair of images can show: what is missing, distances, focal lengths."""
    doubts = []
    if evidence.misscaled_images:
        doubts.append(wrong_distance(evidence.misscaled_images))
    if unscaled := _unconfirmed(evidence, evidence.unscaled_images):
        doubts.append(unknown_distance(unscaled))
    if conflicting := [pair for pair in evidence.conflicting_views if _unconfirmed(evidence, pair)]:
        doubts.append(two_places(conflicting))
    if evidence.unlikely_focal_lengths_px and not priors_confirm(evidence):
        doubts.append(_unlikely_focal(evidence.unlikely_focal_lengths_px))
    return tuple(doubts)


def can_be_left_out(some: int, images: int) -> bool:
    """Whether a model of so many images remains usable without ``some`` of them."""
    return some <= MAX_MISPLACED_SHARE * images and images - some >= MIN_SHARED_IMAGES


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


def _unlikely_focal(focal_px: Sequence[float]) -> str:
    """Why the depths of a model are doubtful, and the remedy."""
    shown = ", ".join(f"{focal:.0f}" for focal in focal_px)
    return (
        f"The estimated focal length, {shown} px, is implausible or contradicts EXIF. A flat scene seen "
        "head-on does not determine it: photograph it from the side, too, or give the camera's calibration."
    )


def priors_are_wrong(evidence: Evidence) -> bool:
    """Whether not only the model but the pairs themselves contradict the position priors."""
    return evidence.prior_support is not None and evidence.prior_support < MIN_PRIOR_SUPPORT


def contradictions_of_priors(evidence: Evidence, images: int, settings: GateSettings) -> list[str]:
    """How a model of so many ``images`` contradicts its position priors, in sentences."""
    found = []
    misplaced, residual = evidence.misplaced_images, evidence.prior_residual_share
    if len(misplaced) > MAX_MISPLACED_SHARE * images:
        found.append(
            f"{len(misplaced)} of its {images} images are far from their position priors: "
            f"{listed(misplaced)}."
        )
    if residual is not None and residual > settings.max_prior_disagreement:
        found.append(f"Its camera centres are {residual:.0%} of the track off their position priors.")
    return found


def _confirmation(
    mapper: str, evidence: Evidence, agreements: Sequence[Agreement], settings: GateSettings
) -> str | None:
    """The independent source that confirms the poses; None if none does."""
    if any(
        mapper in agreement.mappers and agreement.median_share <= settings.max_disagreement
        for agreement in agreements
    ):
        return "two mappers agree on"
    return "GPS confirms" if priors_confirm(evidence) else None


def priors_confirm(evidence: Evidence) -> bool:
    """Whether the position priors are evidence, and the camera centres fit them well."""
    residual = None if priors_are_wrong(evidence) else evidence.prior_residual_share
    return residual is not None and residual <= _CONFIRMING_PRIOR_SHARE


def _unconfirmed(evidence: Evidence, names: Sequence[str]) -> list[str]:
    """Those of the images ``names`` that position priors do not confirm: those of others say nothing."""
    confirm = priors_confirm(evidence)
    return [name for name in names if not confirm or name in evidence.images_without_prior]


def _rank(model: JudgedModel, judgement: Judgement) -> float:
    """The number of explained matches, with a discount for doubt: more images raise it only if right."""
    evidence = model.evidence
    assert evidence is not None
    explained = evidence.match_support * evidence.matches
    return explained if judgement.verdict == "accepted" else _DOUBT * explained


def _rivals(
    other: JudgedModel, best: JudgedModel, agreements: Sequence[Agreement], settings: GateSettings
) -> bool:
    """Whether a model contradicts the ``best`` one and the matches support it as well."""
    contradicts = any(
        set(agreement.mappers) == {best.mapper, other.mapper}
        and agreement.median_share > settings.max_disagreement
        for agreement in agreements
    )
    ours, theirs = best.evidence, other.evidence
    assert ours is not None
    assert theirs is not None
    return contradicts and theirs.match_support >= ours.match_support - _CLOSE_SUPPORT
