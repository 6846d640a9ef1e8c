"""Tiles of an image, and those that an interval of pixels touches: for kernels and for who launches them."""

import triton
import triton.language as tl

TILE_WIDTH, TILE_HEIGHT = 16, 8
SLACK_PX = 0.02
"""Rounding must not drop a pixel whose alpha is just at its threshold."""

_SLACK = tl.constexpr(SLACK_PX)


def tile_counts(size: tuple[int, int]) -> tuple[int, int]:
    """Columns and rows of tiles in an image of ``size``, width and height in px."""
    width, height = size
    return -(-width // TILE_WIDTH), -(-height // TILE_HEIGHT)


@triton.jit
def tile_range(low, high, tiles, SIDE: tl.constexpr):
    """First and last + 1 of ``tiles`` tiles, of ``SIDE`` px, that ``low`` … ``high`` px touches.

    Never last + 1 < first: an interval of 10⁹ px that ``project`` saw just inside of the image may begin
    tiles behind it here, because there the compiler fuses a product and a sum.
    """
    first = (tl.maximum(low - _SLACK, 0.0) / SIDE).to(tl.int32)
    # The minimum comes before the conversion: an interval may reach further than an integer does.
    end = tl.minimum((high + _SLACK) / SIDE, tiles.to(tl.float32)).to(tl.int32) + 1
    end = tl.maximum(tl.minimum(end, tiles), first)
    outside = (high < -_SLACK) | (low > high)
    return tl.where(outside, 0, first), tl.where(outside, 0, end)
