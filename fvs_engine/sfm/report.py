"""Reports of structure from motion, written as JSON."""

from typing import Literal

from fvs_engine.records import Record
from fvs_schema.findings import Finding

Verdict = Literal["accepted", "doubtful", "rejected"]

GIVEN = "given"
"""Used instead of a mapper's name when the poses were given."""


class Evidence(Record):
    """Evidence for a model's poses from the two-view geometries, which do not depend on the model."""

    pairs: int
    """Verified pairs whose two images are both in the model."""

    matches: int
    """Verified matches of those pairs."""

    match_support: float
    """Share of them that lie on the epipolar lines of the final poses and in front of both cameras."""

    rotation_support: float | None
    """Share of the independent relative rotations (weighted by matches) within 5° of the model's."""

    translation_support: float | None
    """Share of the independent translation directions (weighted) within 15° of the model's."""

    cycle_consistency: float | None
    """Share of image triplets whose independent relative rotations close within 5°."""

    unsupported_images: tuple[str, ...]
    """Images that no chain of explained pairs connects with the rest of the model."""

    loosely_linked_images: tuple[str, ...]
    """Images that only pairs of few matches connect with the rest, as look-alike places often are."""

    misscaled_images: tuple[str, ...]
    """Images whose distance to the rest the depths of features seen in three images contradict."""

    unscaled_images: tuple[str, ...]
    """Images whose distance to the rest is not determined: hardly any features are seen in three images."""

    conflicting_views: tuple[tuple[str, str], ...]
    """Pairs of images that should show the same, by this model, and of which large parts do not."""

    unlikely_focal_lengths_px: tuple[float, ...]
    """Refined focal lengths that no usual lens has, or that are far from EXIF's."""

    misplaced_images: tuple[str, ...]
    """Images that are far from their position priors, after an alignment that most of the others fit."""

    images_without_prior: tuple[str, ...] = ()
    """Images without a position prior, where others have one: these say nothing of them."""

    prior_residual_share: float | None
    """Median distance to the position priors after alignment, in shares of their spread; None without."""

    prior_support: float | None
    """Share of the pairs (weighted by matches) whose own baselines fit the position priors."""


class CandidateReport(Record):
    """One mapper's largest model and the verdict on it."""

    mapper: str
    registered: int
    points: int
    mean_reprojection_error_px: float
    evidence: Evidence | None
    verdict: Verdict
    reasons: tuple[Finding, ...]


class ComponentReport(Record):
    """A separate model that could not be merged with the chosen one."""

    mapper: str
    images: tuple[str, ...]


class Agreement(Record):
    """How far two mappers' camera centres are apart after Umeyama, in shares of the scene's spread."""

    mappers: tuple[str, str]
    shared_images: int
    median_share: float
    max_share: float


class SfmReport(Record):
    """How the poses were estimated, and the evidence for them."""

    mapper: str
    """The mapper whose model was chosen, or ``GIVEN``."""

    verdict: Verdict
    images: int
    registered: int
    unregistered: tuple[str, ...]
    points: int
    mean_reprojection_error_px: float
    pairs_matched: int
    pairs_verified: int
    candidates: tuple[CandidateReport, ...]
    agreements: tuple[Agreement, ...]
    other_components: tuple[ComponentReport, ...]
    warnings: tuple[Finding, ...]
    seconds: dict[str, float]
    """Wall-clock time of the stages that ran in this call, s."""
