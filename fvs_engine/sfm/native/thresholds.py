"""The tuned constants of the SfM child, a class for each step.

Errors of images are in shares of the spread of the cameras.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class PoseThresholds:
    """The pose of one image: its search, its review, and whether it is certain enough to be used."""

    min_points: int = 30
    """Number of points for estimating a pose; COLMAP's own limit."""

    min_sigma_px: float = 0.1
    """Standard deviation of reprojection errors that is assumed at least: exact matches tell poses apart."""

    search_sigmas: tuple[float, ...] = (48.0, 16.0, 8.0, 4.0)
    """Errors in standard deviations up to which matches agree with a pose, in one search each.

    COLMAP searches once, to 12 px. Matches that are a few pixels off then count as much as exact ones.
    """

    min_inlier_ratio: float = 0.1
    """Share of the matches that must agree with a pose, in each search."""

    doubted_sigmas: float = 3.0
    """Scale of the robust loss of points and prior, in standard deviations."""

    behind: float = 1e6
    """Square of the error, in standard deviations, of a point behind the camera."""

    iterations: int = 12
    """Steps of a refinement, at most."""

    damping: float = 1e-6
    """Damping of a step of the refinement, in shares of the diagonal."""

    min_prior_position_share: float = 0.005
    """Position sigma of an expected pose, at least, as a share of the cameras' distance from their middle.

    Models have errors, too.
    """

    min_prior_orientation_deg: float = 1.0
    """The same of its orientation."""

    few_points: int = 200
    """Number of points, each seen by two other images, below which an image hangs on few points.

    Wrong poses of *bonsai* (3 to 8 % off) had 64 to 119; of 40 images of a model 6 to 17 have fewer.
    """

    min_gain: float = 5.0
    """By how much another pose must lower the cost: one or two matches that only it fits, or many a little.

    Wrong poses of *bonsai* cost 23 to 107 more than the right ones. Of 55 images that were less than 1 % off,
    four had another pose that lowered it by 5, each nearer to the truth.
    """

    still_explained: float = 0.9
    """Share of the verified matches that the old pose explains, which another one must explain at least."""

    max_position_share: float = 0.02
    """Standard deviation of a position, in spreads of the camera centres, up to which it is certain enough.

    Of 1,278 images of *bonsai*, *castle-P19* and *fox* 7 exceed it, five of them 2.7 to 3.6 % off; the others
    have at most 1.8 %. By *bonsai* alone it would be 1.9 to 2.55 %.
    """

    min_cameras: int = 5
    """Number of registered images from which on a position is judged.

    Of simulated rows of three cameras 18 % of the right images were rejected, of five at most 3 %.
    """

    min_judged_points: int = 10
    """Number of points for judging a position."""

    cells: tuple[int, int] = (6, 4)
    """Columns and rows of the parts of an image that are left out in turn.

    A sixth of an image has often all matches of one edge or surface.
    """

    min_points_left: int = 6
    """Number of points outside a part: three determine a pose, and leave no errors to judge it by."""

    max_near: int = 12
    """Number of best matching images whose depths are compared with an image's own."""

    max_rejections: int = 3
    """Number of rejections of an image's pose in one call after which it is not tried again."""


@dataclass(frozen=True)
class GuidedThresholds:
    """Matches that an expected pose guides. Lengths in an image are in focal lengths."""

    max_looked_at: int = 12
    """Images per call whose known points are read (0.1 s each)."""

    max_guided: int = 4
    """Images per call that are matched (up to 0.4 s each)."""

    sigmas: float = 3.0
    """Half the width of a window, in standard deviations of the expected pose."""

    observations: int = 2
    """Observations per point, from the nearest directions."""

    max_angle_deg: float = 45.0
    """Angle of these directions beyond which SIFT features do not match."""

    max_points: int = 1_500
    """Number of points that are searched: it bounds the time."""

    max_turn_deg: float = 45.0
    """Tolerance of a feature's orientation, relative to the expected one."""

    max_octaves: float = 1.2
    """The same of its size."""

    first_ratio: float = 0.85
    """Maximum ratio of the angles to the nearest and second nearest descriptor, in wide windows."""

    ratio: float = 0.9
    """The same in narrow ones."""

    max_descriptor_deg: float = 22.0
    """Angle between descriptors: most true matches are below it, most chance matches above."""

    min_matches: int = 8
    """Matches that a camera rotation or a refinement needs."""

    hypotheses: int = 4
    """Number of camera rotations that are refined."""

    windows: tuple[float, ...] = (0.04, 0.02, 0.01, 0.01)
    """Radii of the windows in the successive refinements."""

    max_apart_rad: float = 0.3
    """Angle between directions that agree, however near the points are."""

    window_sigmas: float = 5.0
    """Radius of a window in standard deviations of the matches' pixel positions."""

    displacements: tuple[tuple[float, float], ...] = (
        (0.08, 0.0),
        (-0.08, 0.0),
        (0.0, 0.08),
        (0.0, -0.08),
        (0.06, 0.06),
        (-0.06, 0.06),
    )
    """Displacements of the windows that count chance matches."""

    min_believed_matches: int = 30
    """Number of matches of a credible pose."""

    min_believed_ratio: float = 3.0
    """Their ratio to chance matches, at least."""

    max_believed_sigmas: float = 4.5
    """Distance of a credible pose from the expected one, in standard deviations."""

    @property
    def tight(self) -> float:
        """Radius of the last windows."""
        return self.windows[-1]

    @property
    def max_epipolar(self) -> float:
        """Distance of ordinary matches from the epipolar lines of a guided pose."""
        return self.tight / 2


@dataclass(frozen=True)
class AdjustmentThresholds:
    """Robust bundle adjustment of a whole model."""

    cauchy: float = 2.385
    """Scale of Cauchy's loss in standard deviations, for 95 % of the efficiency of least squares."""

    min_sigma_px: float = 0.2
    """Standard deviation of reprojection errors that is assumed at least."""

    tolerance: float = 1e-5
    """Relative change of the cost below which the solver stops."""

    iterations: int = 50
    """Its steps, at most."""

    min_images_of_lens: int = 10
    """Number of images of a camera from which on its principal point and second radial coefficient are
    estimated.

    Six images of *fountain-P11* become worse by them, from 0.12 to 0.18 %, eight of *castle-P19* from 0.24 to
    0.26 %.
    """

    min_view_spread_deg: float = 3.0
    """Spread of the directions of view. Cameras that all look in one direction, as a drone's that photographs
    the ground, do not determine a lens: its errors trade with the depths of the points.

    *brighton* has 1.7°: there vertical errors against GPS rise from 0.21 to 0.43 m. Others have 14 to 78°.
    """

    min_prior_sigma_share: float = 0.005
    """Standard deviation of a prior, at least, as a share of the cameras' distance from their middle."""


POSES = PoseThresholds()
GUIDED = GuidedThresholds()
ADJUSTMENT = AdjustmentThresholds()
