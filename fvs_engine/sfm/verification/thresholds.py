"""Tuned constants of the evidence, a class for each kind; those of the verdicts are in ``GateSettings``.

Errors that these docstrings quote are in shares of the spread of the camera centres.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class PairThresholds:
    """Verified pairs against the poses of a model."""

    max_error_px: float = 4.0
    """Maximum distance of a match from its epipolar line; COLMAP's verification has the same limit."""

    explained_share: float = 0.5
    """Minimum share of the matches of a pair, or between two groups of images, that fit a model that explains
    them.
    """

    min_baseline_share: float = 0.02
    """Minimum distance of two cameras, in shares of the spread, for the direction between them to count."""

    max_rotation_deg: float = 5.0
    """Maximum angle between the rotation estimated from a pair alone and the model's if the two agree.

    Two pairs that agree with the same pose are at most twice as far from each other.
    """

    max_direction_deg: float = 15.0
    """The same for the direction from one camera to the other."""

    max_triplets: int = 20_000
    """Maximum number of triplets of images whose rotations are compared; it bounds the time."""

    min_link_share: float = 0.03
    """Minimum share of a pair's features that match and fit; a pair with fewer may join look-alike places.

    By the weakest link that joins them with the rest, wrong images of *fox* have 0.003 to 0.018, those of
    *bonsai* 0.003 to 0.030; right images of *fox* that are far from all others have 0.018 to 0.04. With 0.025
    two wrong models were accepted (images off by 2.3 and 6.8 times the spread).
    """


@dataclass(frozen=True)
class DepthThresholds:
    """Depths of a feature by two pairs of one image, which are equal in a right model."""

    max_log_error: float = 0.03
    """Maximum absolute logarithm of the ratio of two depths that agree.

    Of 57 right models none is doubted from 0.01 to 0.2. With 0.03 all 57 with a third of the cameras moved by
    30 % of the spread are found, and 53 of those with 10 %; with 0.05 all and 29.
    """

    min_parallax_deg: float = 1.0
    """Minimum angle between the rays of a match whose depth counts; 0.5° or 2° changes little."""

    min_tracks: int = 10
    """Minimum number of features that three images share for a comparison of their distances."""

    max_scatter: float = 0.1
    """Maximum robust standard deviation of the logarithm over the features; 0.3 changes little."""

    max_pairs: int = 12
    """Maximum number of pairs of an image that are compared, those with most depths; it bounds the time."""


@dataclass(frozen=True)
class ConflictThresholds:
    """Pairs of images that should show the same and do not.

    None of 150 right models has any, and 22 of 24 wrong ones of two equal walls do. Of 24 of other walls,
    made after the choice, 2 are accepted instead of 15. Each threshold is among the best by the other scenes.
    """

    min_matched_share: float = 0.08
    """Minimum share of the features that match for a pair to be compared, of the image with fewer."""

    max_angle_deg: float = 8.0
    """Maximum angle between the rays to a point that both images should show: at wider angles features do not
    match.
    """

    max_distance_ratio: float = 1.2
    """Maximum ratio of the distances of the two cameras from such a point."""

    cells: int = 8
    """Number of rows, and of columns, of cells in an image."""

    min_points: int = 3
    """Minimum number of the other image's points in a cell for at least one to be expected there."""

    min_features: int = 5
    """Minimum number of the image's own features in a cell: with fewer, points may stay undetected."""

    min_cells: int = 15
    """Minimum number of cells without an expected point in images that conflict.

    Right models have up to 13, wrong ones often 25 to 50.
    """

    min_share: float = 1 / 3
    """Minimum share of such cells among those in which points are expected."""


@dataclass(frozen=True)
class PriorThresholds:
    """Priors of positions, orientations and focal lengths against a model and its pairs."""

    max_direction_deg: float = 15.0
    """Maximum angle between a pair's baseline and that of its position priors, in addition to their noise.

    Of *fox*, 95 % of the right pairs are off by at most 3°, 95 % of the wrong ones by 39° or more.
    """

    sigmas: float = 2.0
    """Size of that noise, in standard deviations of the priors."""

    max_limit_deg: float = 60.0
    """Maximum sum of both for a pair that is evidence; it is large for cameras near to each other."""

    min_pairs: int = 6
    """Minimum number of pairs for the support of the priors to be known."""

    samples: int = 500
    """Number of rotations between the frames of model and priors that are tried."""

    max_checked_pairs: int = 60
    """Maximum number of pairs from which the support is estimated; each takes 10 ms, and more do not help."""

    max_turn_deg: float = 20.0
    """Maximum angle between the rotation from model to world by positions and that by orientations."""

    min_orientations: int = 3
    """Minimum number of orientations that are compared with each other."""

    max_position_share: float = 0.5
    """Maximum standard deviation of a position prior that is not vague, in shares of the track's spread."""

    max_orientation_deg: float = 30.0
    """The same for an orientation prior."""

    min_residual_positions: int = 4
    """Minimum number of positions for comparing them with the camera centres: three always fit."""

    frozen: int = 3
    """Minimum number of images with exactly the same position for the receiver to count as frozen."""

    max_focal_change: float = 1.5
    """Maximum factor between a focal length prior and the refined value; EXIF is right to a few per cent."""

    focal_shares: tuple[float, float] = (0.35, 3.0)
    """Range of the focal lengths of usual lenses, in shares of the image's long side: 110° to 19° across."""


PAIRS = PairThresholds()
DEPTHS = DepthThresholds()
CONFLICTS = ConflictThresholds()
PRIORS = PriorThresholds()
