"""The record of a projected Gaussian that all kernels share: one row of float32 per splat.

The factors A, k, B of its screen ellipse are those of ``fvs_engine.splat.raster.projection``.
"""

CENTER_X, CENTER_Y = 0, 1
FACTOR_A, FACTOR_K, FACTOR_B = 2, 3, 4
OPACITY = 5
RED, GREEN, BLUE = 6, 7, 8
DEPTH = 9
EXTENT_X, EXTENT_Y = 10, 11
RECORD_SIZE = 12
GRADIENT_SIZE = 10  # gradients exist for all but the extents
