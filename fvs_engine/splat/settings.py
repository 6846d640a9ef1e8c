"""Training settings and presets, and the memory that training needs."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Self

from pydantic import Field, model_validator

from fvs_engine.choices import Quality
from fvs_engine.records import Record


class LearningRates(Record):
    """Adam's step sizes per parameter; those of ``means`` are multiplied by the scene's extent.

    Source: Kerbl et al., 2023, and their published defaults.
    """

    means_first: float = Field(default=1.6e-4, gt=0)
    means_last: float = Field(default=1.6e-6, gt=0)
    log_scales: float = Field(default=5e-3, gt=0)
    quaternions_wxyz: float = Field(default=1e-3, gt=0)
    opacity_logits: float = Field(default=5e-2, gt=0)
    sh_dc: float = Field(default=2.5e-3, gt=0)
    sh_rest: float = Field(default=2.5e-3 / 20, gt=0)

    def times(self, factor: float) -> "LearningRates":
        """The same rates of the positions, and ``factor`` times all others."""
        others = {name: factor * rate for name, rate in self if not name.startswith("means_")}
        return self.model_copy(update=others)


class Densification(Record):
    """Rules by which Gaussians are added and removed; every interval is in iterations.

    It happens at iterations that leave the remainder ``phase`` when divided by ``interval``.
    ``gradient_threshold`` is compared with the mean norm of the loss's gradient with respect to the
    projected centre, in units of half the image (normalised device coordinates). ``dense_extent`` and
    ``prune_extent`` are shares of the scene's extent: smaller Gaussians are cloned and larger ones split;
    those above the latter are removed once opacities were reset.
    """

    first_iteration: int = Field(default=500, ge=0)
    last_iteration: int = Field(default=15_000, ge=0)
    interval: int = Field(default=100, gt=0)
    phase: int = Field(default=0, ge=0)
    opacity_reset_interval: int = Field(default=3_000, gt=0)
    gradient_threshold: float = Field(default=2e-4, gt=0)
    dense_extent: float = Field(default=0.01, gt=0)
    prune_extent: float = Field(default=0.1, gt=0)
    prune_opacity: float = Field(default=0.005, gt=0, lt=1)


class Level(Record):
    """Training on reduced images up to ``until_iteration``: both sides are divided by ``reduction``.

    Up to then a model grows to ``growth`` times ``max_gaussians`` Gaussians at most.
    """

    until_iteration: int = Field(gt=0)
    reduction: int = Field(gt=1)
    growth: float = Field(default=1.0, gt=0, le=1)


_SHARES = {8: 0.5, 4: 0.75, 2: 0.875}
_SHARES_TO_HALF_SIZE = {8: 0.6, 4: 0.9, 2: 1.0}
_SHARES_OF_SMALL_IMAGES = {8: 0.2, 4: 0.35, 2: 0.5}
"""Reduction → the share of the iterations after which images get larger."""


def coarse_to_fine(iterations: int, *, to_half_size: bool = False) -> tuple[Level, ...]:
    """Half of the iterations at an eighth of the size, a quarter at a quarter, an eighth at half of it.

    A small image is cheap and shows what matters at first: positions and colours (docs/design/training.md).
    ``to_half_size``: six, three and one tenth of them, and none at full size, which takes half of the time.
    """
    shares = _SHARES_TO_HALF_SIZE if to_half_size else _SHARES
    return _levels({reduction: share * iterations for reduction, share in shares.items()})


def coarse_to_fine_of_small_images(iterations: int, of_few_views: int) -> tuple[Level, ...]:
    """As ``coarse_to_fine`` up to the iterations ``of_few_views``; up to half of more are at full size.

    At full size iterations of small images are cheap, and few views are overfitted by them.
    """
    least = min(iterations, of_few_views)
    return _levels(
        {
            reduction: max(share * least, _SHARES_OF_SMALL_IMAGES[reduction] * iterations)
            for reduction, share in _SHARES.items()
        }
    )


def _levels(until: Mapping[int, float]) -> tuple[Level, ...]:
    levels = {max(1, round(iteration)): reduction for reduction, iteration in until.items()}
    return tuple(Level(until_iteration=last, reduction=reduction) for last, reduction in levels.items())


class TrainingSettings(Record):
    """Settings of training; stored with every checkpoint.

    The defaults are those of the 3DGS paper for 30,000 iterations. ``max_gaussians`` is a hard cap:
    densification that would exceed it takes the Gaussians with the largest gradients. Images have their full
    size after the last of the ``levels``.
    """

    iterations: int = Field(default=30_000, gt=0)
    sh_degree: int = Field(default=3, ge=0, le=3)
    sh_degree_interval: int = Field(default=1_000, gt=0)
    ssim_weight: float = Field(default=0.2, ge=0, le=1)
    max_gaussians: int = Field(default=1_000_000, gt=0)
    learning_rates: LearningRates = LearningRates()
    densification: Densification = Densification()
    levels: tuple[Level, ...] = ()

    @model_validator(mode="after")
    def _levels_refine(self) -> Self:
        for level, following in pairwise(self.levels):
            if following.until_iteration <= level.until_iteration or following.reduction >= level.reduction:
                raise ValueError("levels must follow each other, each with larger images than the one before")
        return self

    @model_validator(mode="after")
    def _means_do_not_accelerate(self) -> Self:
        if self.learning_rates.means_last > self.learning_rates.means_first:
            raise ValueError("learning_rates.means_last must not exceed means_first")
        return self

    def with_iterations(self, iterations: int) -> "TrainingSettings":
        """The same settings for a run of another length: levels and densification keep their shares of it.

        The spherical harmonics reach their degree within the first half. Opacities are reset as often.
        """
        rules = self.densification
        densification = rules.model_copy(
            update={
                "first_iteration": min(Densification().first_iteration, iterations // 10),
                "last_iteration": rules.last_iteration * iterations // self.iterations,
            }
        )
        levels = {
            max(1, round(level.until_iteration * iterations / self.iterations)): level
            for level in self.levels
        }
        return self.model_copy(
            update={
                "iterations": iterations,
                "sh_degree_interval": min(1_000, max(1, iterations // (2 * max(1, self.sh_degree)))),
                "densification": densification,
                "levels": tuple(
                    level.model_copy(update={"until_iteration": until}) for until, level in levels.items()
                ),
            }
        )

    def sh_degree_at(self, iteration: int) -> int:
        """The degree of spherical harmonics in use: one more every ``sh_degree_interval``."""
        return min(self.sh_degree, iteration // self.sh_degree_interval)

    def reduction_at(self, iteration: int) -> int:
        """What both sides of the images are divided by at this iteration."""
        return next((level.reduction for level in self.levels if iteration < level.until_iteration), 1)

    def max_gaussians_at(self, iteration: int) -> int:
        """The maximum number of Gaussians at this iteration."""
        growth = next((level.growth for level in self.levels if iteration < level.until_iteration), 1.0)
        return max(1, round(growth * self.max_gaussians))

    def work_until(self, iteration: int) -> float:
        """The cost of the iterations before ``iteration``, in full-size iterations.

        An iteration takes time for its pixels and for its Gaussians: about in proportion to the side.
        """
        work, begin = 0.0, 0
        for level in self.levels:
            end = min(iteration, level.until_iteration)
            work += max(0, end - begin) / level.reduction
            begin = level.until_iteration
        return work + max(0, iteration - begin)


PRESETS: dict[Quality, TrainingSettings] = {
    "coarse": TrainingSettings(
        iterations=2_000,
        sh_degree=0,
        max_gaussians=300_000,
        densification=Densification(first_iteration=200, last_iteration=1_000),
        levels=coarse_to_fine(2_000),
    ),
    "fine": TrainingSettings(
        sh_degree=3,
        learning_rates=LearningRates().times(2),
        densification=Densification(last_iteration=21_000, opacity_reset_interval=15_000),
        levels=(
            Level(until_iteration=9_000, reduction=4, growth=0.25),
            Level(until_iteration=18_000, reduction=2, growth=0.5),
        ),
    ),
}
"""``coarse`` ranks candidates during the flight; ``fine`` is for the final model (docs/design/training.md).

The Gaussians of ``fine`` multiply as its images grow: three tenths of the iterations are at a quarter of the
size with a quarter of the Gaussians, three at half of both. Opacities are reset once, after half of the
30,000 iterations; shorter runs of fewer than 21,600 go without, for lack of time to recover.
"""

_FLOAT_BYTES = 4
_COPIES = 4
"""A parameter, its gradient, and Adam's two moments."""
_SCREEN_FLOATS = 32
"""Per Gaussian: the projection's results for the backward pass, screen gradients and statistics."""
_HITS_PER_GAUSSIAN = 6
_HIT_BYTES = 64
_GROWTH_FACTOR = 4.5
"""Peak over the steady state: while Gaussians are added, old and new copies of everything exist, checkpoints
copy them once more, and freed blocks wait in pieces. Measured: bonsai with 350,000 Gaussians of degree 3
peaked at 3.07 GiB, of which 0.8 GiB were the program and the images."""
_PIXEL_FLOATS = 16
"""Per pixel of one image: colour, alpha, depth, their gradients, and the rasteriser's state."""


def memory_need_bytes(gaussians: int, sh_degree: int, views: int, width_px: int, height_px: int) -> int:
    """Approximate upper bound of the memory that training on the CPU needs, without the program itself.

    ``views`` images of ``width_px`` × ``height_px`` (kept as bytes), and ``gaussians`` with their
    gradients, moments and rasteriser state, at the moment when Gaussians are added.
    """
    parameters = 3 + 3 + 4 + 1 + 3 * sh_coefficient_count(sh_degree)
    largest = 3 * max(1, sh_coefficient_count(sh_degree) - 1)
    per_gaussian = _FLOAT_BYTES * (_COPIES * parameters + largest + _SCREEN_FLOATS)
    per_gaussian += _HITS_PER_GAUSSIAN * _HIT_BYTES
    pixels = width_px * height_px
    images = views * 3 * pixels + _FLOAT_BYTES * _PIXEL_FLOATS * pixels
    return round(_GROWTH_FACTOR * gaussians * per_gaussian) + images


def sh_coefficient_count(degree: int) -> int:
    """Number of spherical-harmonics coefficients per colour channel up to ``degree``."""
    return (degree + 1) ** 2
