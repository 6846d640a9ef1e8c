"""Tuned constants of the SfM child, a class for each step.

Errors that these docstrings quote are in shares of the spread of the camera centres.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class PoseThresholds:
    """The pose of one image: its search, its review, and whether it is certain enough to be used."""

    min_points: int = 30
    """Minimum number of points for estimating a pose; COLMAP has the same limit."""

    min_sigma_px: float = 0.1
    """Minimum standard deviation of reprojection errors that is assumed."""

    search_sigmas: tuple[float, ...] = (48.0, 16.0, 8.0, 4.0)
    """Maximum error of a match that agrees with a pose, in standard deviations, for each of the searches.

    COLMAP searches once, with 12 px, so that matches that are a few pixels off count as much as exact ones.
    """

    min_inlier_ratio: float = 0.1
    """Minimum share of the matches that agree with a pose, in each search."""

    doubted_sigmas: float = 3.0
    """Scale of the robust loss of points and prior, in standard deviations."""

    behind: float = 1e6
    """Squared error assumed for a point behind the camera, in squared standard deviations."""

    iterations: int = 12
    """Maximum number of steps of a refinement."""

    damping: float = 1e-6
    """Damping of the normal equations in a refinement, relative to their diagonal."""

    min_prior_position_share: float = 0.005
    """Minimum position sigma of an expected pose, in shares of the spread of the positions.

    Models have errors, too.
    """

    min_prior_orientation_deg: float = 1.0
    """Minimum orientation sigma of an expected pose."""

    few_points: int = 200
    """Number of points that at least two other images see, below which an image hangs on few points.

    Wrong poses of *bonsai* (3 to 8 % off) had 64 to 119; of 40 images of a model 6 to 17 have fewer.
    """

    min_gain: float = 5.0
    """Reduction of the cost above which another pose replaces the present one.

    One or two matches that only the other pose fits suffice, or many that it fits a little better.

    Wrong poses of *bonsai* cost 23 to 107 more than the right ones. Of 55 images that were less than 1 % off,
    four had another pose that lowered it by 5, each nearer to the truth.
    """

    still_explained: float = 0.9
    """Minimum number of verified matches that another pose explains, as a share of those of the old pose."""

    max_position_share: float = 0.02
    """Maximum standard deviation of the position of a registered image, in shares of the spread.

    Of 1,278 images of *bonsai*, *castle-P19* and *fox* 7 exceed it, five of them 2.7 to 3.6 % off; the others
    have at most 1.8 %. By *bonsai* alone it would be 1.9 to 2.55 %.
    """

    min_cameras: int = 5
    """Minimum number of registered images for judging a position.

    Of simulated rows of three cameras 18 % of the right images were rejected, of five at most 3 %.
    """

    min_judged_points: int = 10
    """Minimum number of points for judging a position."""

    cells: tuple[int, int] = (6, 4)
    """Number of columns and of rows of cells in an image, which are left out one after another.

    A sixth of an image often holds all matches of one edge or surface.
    """

    min_points_left: int = 6
    """Minimum number of points outside a cell: three determine a pose, and leave no errors to judge it by."""

    max_near: int = 12
    """Maximum number of images whose depths are compared with an image's own, those that match it best."""

    max_rejections: int = 3
    """Number of rejections of an image's pose in one call after which it is not tried again."""


@dataclass(frozen=True)
class GuidedThresholds:
    """Matches that an expected pose guides; lengths in images are in shares of the focal length."""

    max_looked_at: int = 12
    """Maximum number of images per call whose known points are read (0.1 s each)."""

    max_guided: int = 4
    """Maximum number of images per call that are matched (up to 0.4 s each)."""

    sigmas: float = 3.0
    """Half the width of a window, in standard deviations of the expected pose."""

    observations: int = 2
    """Maximum number of observations of a point that are used, those from the nearest directions."""

    max_angle_deg: float = 45.0
    """Maximum angle between such a direction and the expected one: beyond it SIFT features do not match."""

    max_points: int = 1_500
    """Maximum number of points that are searched for; it bounds the time."""

    max_turn_deg: float = 45.0
    """Maximum angle between a feature's orientation in the image and the expected one."""

    max_octaves: float = 1.2
    """Maximum ratio of a feature's size to the expected one, either way, as a binary logarithm."""

    first_ratio: float = 0.85
    """Maximum ratio of the angles to the nearest and second nearest descriptor, in wide windows."""

    ratio: float = 0.9
    """The same in narrow windows."""

    max_descriptor_deg: float = 22.0
    """Maximum angle between descriptors: most true matches are below it, most chance matches above."""

    min_matches: int = 8
    """Minimum number of matches for a camera rotation or a refinement."""

    hypotheses: int = 4
    """Maximum number of camera rotations that are refined."""

    windows: tuple[float, ...] = (0.04, 0.02, 0.01, 0.01)
    """Radii of the windows in the successive refinements."""

    max_apart_rad: float = 0.3
    """Maximum angle between directions that agree, however near the points are."""

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
    """Minimum number of matches of a credible pose."""

    min_believed_ratio: float = 3.0
    """Minimum ratio of these matches to chance matches."""

    max_believed_sigmas: float = 4.5
    """Maximum distance of a credible pose from the expected one, in standard deviations."""

    @property
    def tight(self) -> float:
        """Radius of the last windows."""
        return self.windows[-1]

    @property
    def max_epipolar(self) -> float:
        """Maximum distance of ordinary matches from the epipolar lines of a guided pose."""
        return self.tight / 2


@dataclass(frozen=True)
class AdjustmentThresholds:
    """Robust bundle adjustment of a whole model."""

    cauchy: float = 2.385
    """Scale of Cauchy's loss in standard deviations, for 95 % of the efficiency of least squares."""

    min_sigma_px: float = 0.2
    """Minimum standard deviation of reprojection errors that is assumed."""

    tolerance: float = 1e-5
    """Relative change of the cost below which the solver stops."""

    iterations: int = 50
    """Maximum number of its steps."""

    min_images_of_lens: int = 10
    """Minimum number of a camera's images for estimating its principal point and second radial coefficient.

    Six images of *fountain-P11* become worse by them, from 0.12 to 0.18 %, eight of *castle-P19* from 0.24 to
    0.26 %.
    """

    min_view_spread_deg: float = 3.0
    """Minimum spread of the viewing directions for estimating a lens.

    Cameras that all look in one direction, like those of a drone above the ground, do not determine a lens:
    its errors trade with the depths of the points.

    *brighton* has 1.7°: there vertical errors against GPS rise from 0.21 to 0.43 m. Others have 14 to 78°.
    """

    min_prior_sigma_share: float = 0.005
    """Minimum standard deviation of a position prior, in shares of the spread of the positions."""


POSES = PoseThresholds()
GUIDED = GuidedThresholds()
ADJUSTMENT = AdjustmentThresholds()
