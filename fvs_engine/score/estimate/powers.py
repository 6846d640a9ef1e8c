"""The power spectrum of a view, computed from its splats without rendering pixels.

A splat with the screen covariance Σ adds a Gaussian to the image, whose power at the frequency f is known:
(2π)² |Σ| exp(−4π² fᵀ Σ f), times the square of its contrast: how much of it is seen, its opacity, and how its
colour differs from that of the cell around it. Splats are taken as independent of one another, so their
powers add up.

Blurred views have so little power of that kind that three others matter, which a render's FFT sees as well:
splats end where their alpha falls under 1/255 (a step along an ellipse); and the FFT takes the left and the
right border of the image for neighbours (a step where splats cross it), and the upper and the lower one.
"""

import math

import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, inlined_kernel, kernel
from fvs_engine.score.estimate.cells import LEAST_SEEN, determinant
from fvs_engine.score.estimate.projection import REACH, XX, XY, YY
from fvs_engine.splat.conventions import ALPHA_MIN, CENTER_X, CENTER_Y, OPACITY, RED
from fvs_engine.splat.raster.kernels.blending import exp_of_minus_eight

Floats = NDArray[np.float32]

FREQUENCIES = 32
"""Number of frequencies; a compile-time constant, so that the loops over them are vectorised."""
SPACING = 0.125
"""Between two frequencies of the grid, in cycles/px."""
SMOOTHING = F(8 * math.pi**2 * SPACING**2 / 12)
"""A long splat has its power in a thin line of frequencies, which hits the grid or misses it. So powers are
averaged around every frequency, by a Gaussian of the variance of a square of the grid. In 1 / px²."""
EVENNESS = F(0.2)
"""Where few splats have most of the power it lies in few places: the median is lower than the mean tells. The
exponent of their effective number, found by experiment."""
LEAST_ALPHA = F(ALPHA_MIN)
TWO_PI, FOUR_PI2 = F(2 * math.pi), F(4 * math.pi * math.pi)
MOST_EXPONENT = F(24)


@inlined_kernel
def exp_of_minus(x: float) -> float:
    """exp(−x) for x in [0, 24]; exp(−24) for a larger x."""
    power = exp_of_minus_eight(x * F(1 / 32))
    power *= power
    return power * power


@kernel
def sum_powers(
    splats: Floats, cells: Floats, side: float, seen: Floats, size: tuple[int, int], grid: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Add up the powers of all splats, per colour, at the frequencies ``grid`` [32, 2] in cycles/px.

    ``cells``, of ``side`` px, and ``seen`` are those of ``cells.cover``. Returns the powers [3, 32] of the
    splats' bodies, those along the borders that they cross, of the step in x and in y, and [3] those of their
    edges, over 1 / (2π² |f|³).
    """
    width, height = F(size[0]), F(size[1])
    rows, columns = cells.shape[1], cells.shape[2]
    squares = np.empty(3 * FREQUENCIES, np.float32)
    for f in range(FREQUENCIES):
        squares[f] = grid[f, 0] * grid[f, 0]
        squares[f + FREQUENCIES] = F(2) * grid[f, 0] * grid[f, 1]
        squares[f + 2 * FREQUENCIES] = grid[f, 1] * grid[f, 1]
    along_x, along_y = squares[:FREQUENCIES], squares[2 * FREQUENCIES :]
    inside = np.zeros(4 * FREQUENCIES, np.float32)  # of red, green, blue; squared powers of all three
    across_x, across_y = np.zeros(3 * FREQUENCIES, np.float32), np.zeros(3 * FREQUENCIES, np.float32)
    red_step, green_step, blue_step = F(0), F(0), F(0)
    for n in range(splats.shape[0]):
        if seen[n] < LEAST_SEEN:
            continue
        record = splats[n]
        x, y, xx, xy, yy = record[CENTER_X], record[CENTER_Y], record[XX], record[XY], record[YY]
        volume = determinant(record)
        row = min(max(int(y / side), 0), rows - 1)
        column = min(max(int(x / side), 0), columns - 1)
        amplitude = seen[n] * record[OPACITY]
        red = (amplitude * (record[RED] - cells[1, row, column])) ** 2
        green = (amplitude * (record[RED + 1] - cells[2, row, column])) ** 2
        blue = (amplitude * (record[RED + 2] - cells[3, row, column])) ** 2
        # Those whose centre is outside count by what they add along the border only, or not at all: many are
        # huge, near the camera, and known badly.
        in_x, in_y = F(0) <= x < width, F(0) <= y < height
        if in_x and in_y:
            spread = F(1) + SMOOTHING * (xx + yy + SMOOTHING * volume)
            rounder, inverse = SMOOTHING * volume, F(1) / spread
            a, b, c = (xx + rounder) * inverse, xy * inverse, (yy + rounder) * inverse
            scale, gray = FOUR_PI2 * volume * math.sqrt(inverse), red + green + blue
            for lane in range(FREQUENCIES):
                j = np.uint64(lane)
                exponent = squares[j] * a
                exponent += squares[j + np.uint64(FREQUENCIES)] * b
                exponent += squares[j + np.uint64(2 * FREQUENCIES)] * c
                power = scale * exp_of_minus(min(FOUR_PI2 * exponent, MOST_EXPONENT))
                inside[j] += red * power
                inside[j + np.uint64(FREQUENCIES)] += green * power
                inside[j + np.uint64(2 * FREQUENCIES)] += blue * power
                inside[j + np.uint64(3 * FREQUENCIES)] += (gray * power) ** 2
            relative = LEAST_ALPHA / record[OPACITY]
            edge = relative * relative * record[REACH] * math.sqrt(math.sqrt(volume))
            red_step += edge * red
            green_step += edge * green
            blue_step += edge * blue
        if in_y:
            _add_crossing(x, width, xx, volume / xx, (red, green, blue), along_y, across_x)
        if in_x:
            _add_crossing(y, height, yy, volume / yy, (red, green, blue), along_x, across_y)
    steps = np.array([red_step, green_step, blue_step], np.float32)
    shape = (3, FREQUENCIES)
    return _evened(inside.reshape(4, FREQUENCIES)), across_x.reshape(shape), across_y.reshape(shape), steps


@kernel
def _evened(powers: Floats) -> Floats:
    """The first three rows, higher the more splats share in them; the fourth is the sum of squares."""
    evened = np.zeros((3, FREQUENCIES), np.float32)
    for j in range(FREQUENCIES):
        if powers[3, j] > F(0):
            total = powers[0, j] + powers[1, j] + powers[2, j]
            factor = (total * total / powers[3, j]) ** EVENNESS
            for c in range(3):
                evened[c, j] = factor * powers[c, j]
    return evened


@kernel
def _add_crossing(
    position: float,
    end: float,
    variance: float,
    variance_along: float,
    contrasts: tuple[float, float, float],
    squares: Floats,
    power: Floats,
) -> None:
    """Add to ``power`` [96], along the borders at 0 and ``end``, what a splat adds that crosses one of them.

    ``squares`` [32] are those of the frequencies along the border.
    """
    red, green, blue = contrasts
    for border in (F(0), end):
        distance = position - border
        if distance * distance > F(9) * variance:
            continue
        inverse = F(1) / (F(1) + SMOOTHING * variance_along)
        scale = TWO_PI * variance_along * math.sqrt(inverse)
        scale *= exp_of_minus(distance * distance / variance)
        for lane in range(FREQUENCIES):
            j = np.uint64(lane)
            value = scale * exp_of_minus(min(FOUR_PI2 * inverse * variance_along * squares[j], MOST_EXPONENT))
            power[j] += red * value
            power[j + np.uint64(FREQUENCIES)] += green * value
            power[j + np.uint64(2 * FREQUENCIES)] += blue * value


@kernel
def median_log_magnitude(powers: NDArray[np.float64]) -> float:
    """The median of ln |F| over coefficients whose real and imaginary parts are normal; their ``powers`` [P].

    A share 1 − exp(−m² / p) of the magnitudes of the power p is below m; the median is found by bisection.
    −inf where a power is 0 or not finite.
    """
    least, greatest = powers.min(), powers.max()
    if not (least > 0.0 and math.isfinite(greatest)):
        return -math.inf
    low, high = math.log(least) - 2.0, math.log(greatest) + 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        square = math.exp(middle)
        below = 0.0
        for power in powers:
            below += 1.0 - math.exp(-square / power)
        if below < 0.5 * powers.size:
            low = middle
        else:
            high = middle
    return 0.25 * (low + high)
