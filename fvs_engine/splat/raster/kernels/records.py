"""The record of a projected Gaussian that all kernels share: one row of float32 per splat.

The factors A, k, B of its screen ellipse are those of ``fvs_engine.splat.raster.reference_projection``.
"""

CENTER_X, CENTER_Y = 0, 1
FACTOR_A, FACTOR_K, FACTOR_B = 2, 3, 4
OPACITY = 5
RED, GREEN, BLUE = 6, 7, 8
DEPTH = 9
EXTENT_X, EXTENT_Y = 10, 11  # half sides of the box around the ellipse
WIDTH, HEIGHT = 12, 13  # half its width on the row of its centre, half its height on the column of its centre
SLOPE_X, SLOPE_Y = (
    14,
    15,
)  # its middle moves by SLOPE_X px in x per px in y (that is k), by SLOPE_Y px in y per px in x
RECORD_SIZE = 16  # one cache line
GRADIENT_SIZE = 10  # gradients exist up to DEPTH
