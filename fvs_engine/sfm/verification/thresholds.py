"""The tuned constants of the evidence, a class for each kind; those of the verdicts are in ``GateSettings``.

Errors of images and models are in shares of the spread of the cameras.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class PairThresholds:
    """Verified pairs against the poses of a model."""

    max_error_px: float = 4.0
    """Distance of a match from its epipolar line: the limit of COLMAP's verification, which it has passed."""

    explained_share: float = 0.5
    """Share of a pair's matches, or of those between two groups of images, that must fit to explain them."""

    min_baseline_share: float = 0.02
    """Distance of two cameras, in shares of the spread, below which the direction between them is noise."""

    max_rotation_deg: float = 5.0
    """Difference of a pair's own relative rotation from the model's up to which they agree."""

    max_direction_deg: float = 15.0
    """The same of the direction from one camera to the other."""

    max_triplets: int = 20_000
    """Number of triplets of images whose rotations are closed: it bounds the time."""

    min_link_share: float = 0.03
    """Share of a pair's features that match and fit from which on it is no look-alike pair.

    By the weakest link that joins them with the rest, wrong images of *fox* have 0.003 to 0.018, those of
    *bonsai* 0.003 to 0.030; right images of *fox* that are far from all others have 0.018 to 0.04. With 0.025
    two wrong models were accepted (images off by 2.3 and 6.8 times the spread).
    """


@dataclass(frozen=True)
class DepthThresholds:
    """Depths that a feature has by two pairs of one image, the same in a right model."""

    max_log_error: float = 0.03
    """Absolute logarithm of their ratio up to which they agree.

    Of 57 right models none is doubted from 0.01 to 0.2. With 0.03 all 57 with a third of the cameras moved by
    30 % of the spread are found, and 53 of those with 10 %; with 0.05 all and 29.
    """

    min_parallax_deg: float = 1.0
    """Angle between the rays of a match from which on its depth is evidence; 0.5 or 2 changes little."""

    min_tracks: int = 10
    """Number of features below which three images say nothing about their distances."""

    max_scatter: float = 0.1
    """Robust standard deviation of the logarithm above which features disagree; 0.3 changes little."""

    max_pairs: int = 12
    """Number of pairs of an image, those with most depths, that are compared: it bounds the time."""


@dataclass(frozen=True)
class ConflictThresholds:
    """Two images that should show the same, and do not.

    None of 150 right models has any, and 22 of 24 wrong ones of two equal walls do. Of 24 of other walls,
    made after the choice, 2 are accepted instead of 15. Each threshold is among the best by the other scenes.
    """

    min_matched_share: float = 0.08
    """Share of the features that match from which on two images show much the same."""

    max_angle_deg: float = 8.0
    """Angle between two views of a point up to which both must show it; wider, features do not match."""

    max_distance_ratio: float = 1.2
    """The same for the ratio of their distances to it."""

    cells: int = 8
    """Rows and columns of cells of an image."""

    min_points: int = 3
    """Points of the other image in a cell from which on some must be seen there."""

    min_features: int = 5
    """Features of the image in a cell below which it may not see them."""

    min_cells: int = 15
    """Cells without any from which on images conflict: up to 13 in right models, often 25 to 50 in wrong."""

    min_share: float = 1 / 3
    """Their share of all cells in which points are expected."""


@dataclass(frozen=True)
class PriorThresholds:
    """Priors of positions, orientations and focal lengths against a model and its pairs."""

    max_direction_deg: float = 15.0
    """Angle between a pair's baseline and that of its positions, beyond their noise, that is a contradiction.

    Of *fox*, 95 % of the right pairs are off by at most 3°, 95 % of the wrong ones by 39° or more.
    """

    sigmas: float = 2.0
    """Standard deviations of the priors that a contradiction must exceed."""

    max_limit_deg: float = 60.0
    """Maximum limit of a pair that is evidence; images near to each other have wider ones."""

    min_pairs: int = 6
    """Number of pairs below which the support of the priors is unknown."""

    samples: int = 500
    """Number of rotations that are tried between the frames of model and priors."""

    max_checked_pairs: int = 60
    """Number of pairs that the support is estimated from: more do not improve it, and each takes 10 ms."""

    max_turn_deg: float = 20.0
    """Angle between the rotations by positions and by orientations beyond which the latter are wrong."""

    min_orientations: int = 3
    """Number of orientations that can contradict each other."""

    max_position_share: float = 0.5
    """Standard deviation of a position, as a share of the track, up to which a prior tells what is seen."""

    max_orientation_deg: float = 30.0
    """The same of an orientation."""

    min_residual_positions: int = 4
    """Number of positions from which on their distance from the camera centres is known: three always fit."""

    frozen: int = 3
    """Number of images with exactly the same position from which on the receiver counts as frozen."""

    max_focal_change: float = 1.5
    """Factor between a focal length prior and the refined focal length; EXIF is right to a few per cent."""

    focal_shares: tuple[float, float] = (0.35, 3.0)
    """Focal lengths of usual lenses in shares of the long side of the image: 110° to 19° across."""


PAIRS = PairThresholds()
DEPTHS = DepthThresholds()
CONFLICTS = ConflictThresholds()
PRIORS = PriorThresholds()
