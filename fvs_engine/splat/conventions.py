"""What all rasterisers share: the rules of blending, and the record of a projected Gaussian.

The rules are those of gsplat's "classic" mode, so that the backends can be tested against one another:

* a Gaussian is culled when its depth is < ``NEAR_PLANE`` or its screen ellipse misses the image;
* the 2D covariance gets ``BLUR_PX2`` added to its diagonal (the low-pass of the 3DGS paper);
* the ellipse extends to ``3.33 σ`` or to where alpha falls under 1/255, whichever is nearer;
* a splat's alpha is min(0.999, opacity · exp(−½ dᵀ Σ⁻¹ d)), skipped under 1/255;
* a pixel is finished before the splat that would take its transmittance under ``TRANSMITTANCE_MIN``;
* splats are blended front to back by the depth of their centres; ties by index.

A record is one row of float32 per splat. The factors A, k, B of its screen ellipse are those of
``raster.reference_projection``.
"""

NEAR_PLANE = 0.01
BLUR_PX2 = 0.3
ALPHA_MIN = 1.0 / 255.0
ALPHA_MAX = 0.999
TRANSMITTANCE_MIN = 1e-4

CENTER_X, CENTER_Y = 0, 1
FACTOR_A, FACTOR_K, FACTOR_B = 2, 3, 4
OPACITY = 5
RED, GREEN, BLUE = 6, 7, 8
DEPTH = 9
EXTENT_X, EXTENT_Y = 10, 11  # half sides of the box around the ellipse
WIDTH, HEIGHT = 12, 13  # half its width on the row of its centre, half its height on the column of its centre
SLOPE_X, SLOPE_Y = 14, 15  # its middle moves by SLOPE_X px in x per px in y (that is k), and the other way
RECORD_SIZE = 16  # one cache line
GRADIENT_SIZE = 10  # gradients exist up to DEPTH
