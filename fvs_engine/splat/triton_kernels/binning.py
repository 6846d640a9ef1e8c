"""Which splats touch which tiles, front to back, for all cameras at once and without asking the device.

Splats are sorted by depth, per camera; the hits (one splat in one tile) of a splat's box are numbered in
that order, so that those of one splat are neighbours; a stable sort by tile then lists the hits of every tile
front to back. Hits of the box that the ellipse misses are listed behind all tiles.

Read and written per Gaussian and camera: some 300 bytes, a third of them by the sort by depth; per hit of a
box: 80 bytes, or 140 with more than 65,535 tiles, whose numbers need 32 bits; the sort takes 50 or 110.
"""

from dataclasses import dataclass

import torch
import triton
import triton.language as tl
from torch import Tensor

from fvs_engine.splat import conventions
from fvs_engine.splat.triton_kernels import guard as guards
from fvs_engine.splat.triton_kernels.projection import Projected
from fvs_engine.splat.triton_kernels.tiles import SLACK_PX, TILE_HEIGHT, TILE_WIDTH, tile_counts, tile_range

BLOCK = 256
PREFETCHED = 2
"""How many slots behind a tile's last one blending may read."""

RECORD = tl.constexpr(conventions.RECORD_SIZE)
CENTER_X, CENTER_Y = tl.constexpr(conventions.CENTER_X), tl.constexpr(conventions.CENTER_Y)
EXTENT_X, EXTENT_Y = tl.constexpr(conventions.EXTENT_X), tl.constexpr(conventions.EXTENT_Y)
WIDTH = tl.constexpr(conventions.WIDTH)
SLOPE_X, SLOPE_Y = tl.constexpr(conventions.SLOPE_X), tl.constexpr(conventions.SLOPE_Y)
TILE_W, TILE_H, SLACK = tl.constexpr(TILE_WIDTH), tl.constexpr(TILE_HEIGHT), tl.constexpr(SLACK_PX)
OVERFLOW = tl.constexpr(guards.HALTED_OVERFLOW)
REASON, NEEDED = tl.constexpr(guards.REASON), tl.constexpr(guards.HITS_NEEDED)


@dataclass(frozen=True)
class Hits:
    """The hits of C cameras, N Gaussians and T tiles per camera; Gaussian n is splat camera · N + n there.

    A *slot* is a place in the lists of all tiles, one after the other. ``tile_starts`` int32 [C · T + 1] are
    the first slots of the tiles camera · T + tile; ``listed`` int32 [capacity + 2] is the splat of each slot,
    a valid one even in slots of no tile; ``numbers`` int32 [capacity] is the number of the hit there.
    ``order`` int64 [C, N] are the Gaussians of each camera by depth, culled ones last, and the hits of the
    splat in place i of all cameras' orders are ``starts[i]`` … ``starts[i + 1]`` − 1 of ``starts`` int64
    [C · N + 1], which is not cut at the capacity: ``starts[-1]`` hits were needed.
    """

    tile_starts: Tensor
    listed: Tensor
    numbers: Tensor
    order: Tensor
    starts: Tensor

    @property
    def capacity(self) -> int:
        """How many hits there is room for."""
        return len(self.numbers)


def bin_hits(
    projected: Projected, size: tuple[int, int], capacity: int | None = None, guard: Tensor | None = None
) -> Hits:
    """List the hits of every tile in images of ``size``, width and height in px.

    With a ``capacity`` the host does not wait for the device; hits beyond it are left out, and ``guard`` is
    set. Without one it waits once, and there is room for all.
    """
    records, radii = projected.records, projected.radii
    cameras, count = radii.shape
    tiles_x, tiles_y = tile_counts(size)
    tiles = cameras * tiles_x * tiles_y
    depths = torch.where(radii > 0, records[..., conventions.DEPTH], torch.inf)
    order = torch.sort(depths, dim=1, stable=True).indices
    splats = cameras * count
    counts = torch.empty(splats, dtype=torch.int32, device=radii.device)
    if splats > 0:
        _count_hits[(triton.cdiv(splats, BLOCK),)](
            records, radii, order, counts, splats, count, tiles_x, tiles_y, BLOCK=BLOCK
        )
    starts = torch.zeros(splats + 1, dtype=torch.int64, device=radii.device)
    torch.cumsum(counts, 0, dtype=torch.int64, out=starts[1:])
    if capacity is None:
        capacity = int(starts[-1])
        guards.check_hits(capacity)

    # Fewer bits take fewer passes of the sort, which knows only signed ones.
    kind, tile_zero = (torch.int16, -(1 << 15)) if tiles < 1 << 16 else (torch.int32, 0)
    tile_of_hit = torch.empty(capacity, dtype=kind, device=radii.device)
    splat_of_hit = torch.empty(capacity, dtype=torch.int32, device=radii.device)
    _deal_hits[(max(1, triton.cdiv(capacity, BLOCK)),)](
        records, order, starts, tile_of_hit, splat_of_hit,
        capacity, splats, count, tiles_x, tiles_y, tile_zero, tiles, guard, BLOCK=BLOCK, num_warps=2,
    )  # fmt: skip
    tile_of_slot, hit_of_slot = torch.sort(tile_of_hit, stable=True)
    all_tiles = torch.arange(tile_zero, tile_zero + tiles + 1, dtype=kind, device=radii.device)
    tile_starts = torch.searchsorted(tile_of_slot, all_tiles, out_int32=True)
    listed = torch.empty(capacity + PREFETCHED, dtype=torch.int32, device=radii.device)
    numbers = torch.empty(capacity, dtype=torch.int32, device=radii.device)
    _list_hits[(triton.cdiv(capacity + PREFETCHED, BLOCK),)](
        hit_of_slot, splat_of_hit, listed, numbers, capacity, capacity + PREFETCHED, BLOCK=BLOCK
    )
    return Hits(tile_starts, listed, numbers, order, starts)


@triton.jit
def tile_box(record, is_there, tiles_x, tiles_y):
    """First and last + 1 column, first and last + 1 row of the tiles that the boxes of records touch."""
    x, y = (
        tl.load(record + CENTER_X, mask=is_there, other=0.0),
        tl.load(record + CENTER_Y, mask=is_there, other=0.0),
    )
    extent_x = tl.load(record + EXTENT_X, mask=is_there, other=0.0)
    extent_y = tl.load(record + EXTENT_Y, mask=is_there, other=0.0)
    first_column, end_column = tile_range(x - extent_x, x + extent_x, tiles_x, TILE_W)
    first_row, end_row = tile_range(y - extent_y, y + extent_y, tiles_y, TILE_H)
    return first_column, end_column, first_row, end_row


@triton.jit
def ellipse_span(low, high, extent, summit, half_width, slope):
    """The extent of an ellipse around the origin across a band ``low`` … ``high`` of its coordinate s.

    The ellipse lives on s in ± ``extent``; there it spans t = slope · s ± half_width · √(1 − (s / extent)²)
    and t is greatest at ``summit``. Returns the least and the greatest t; empty when least > greatest.
    """
    outside = (low > extent) | (high < 0.0 - extent)
    s = tl.minimum(tl.maximum(summit, low), high)
    part = s / extent
    greatest = slope * s + half_width * tl.sqrt(tl.maximum(1.0 - part * part, 0.0))
    s = tl.minimum(tl.maximum(0.0 - summit, low), high)
    part = s / extent
    least = slope * s - half_width * tl.sqrt(tl.maximum(1.0 - part * part, 0.0))
    return tl.where(outside, 1.0, least), tl.where(outside, -1.0, greatest)


@triton.jit(do_not_specialize=["splats", "count", "tiles_x", "tiles_y"])
def _count_hits(records, radii, order, counts, splats, count, tiles_x, tiles_y, BLOCK: tl.constexpr):
    """Tiles of the box of every splat, front to back; none for a culled one."""
    places = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = places < splats
    splat = places // count * count + tl.load(order + places, mask=inside, other=0).to(tl.int32)
    is_visible = tl.load(radii + splat, mask=inside, other=0.0) > 0  # nothing is known of others
    record = records + splat.to(tl.int64) * RECORD
    first_column, end_column, first_row, end_row = tile_box(record, is_visible, tiles_x, tiles_y)
    hits = tl.where(is_visible, (end_column - first_column) * (end_row - first_row), 0)
    tl.store(counts + places, hits, mask=inside)


@triton.jit
def _place_of(number, starts, low, high, choices):
    """The place, in depth order, of the splat whose hit has this number, between ``low`` and ``high`` − 1.

    Numbers or tensors of them; ``choices`` is the greatest high − low.
    """
    while choices > 1:
        middle = (low + high) // 2
        is_behind = tl.load(starts + middle) <= number
        low = tl.where(is_behind, middle, low)
        high = tl.where(is_behind, high, middle)
        choices = (choices + 1) // 2
    return low


@triton.jit
def _set_guard(guard, needed, overflows):
    """Keep an earlier reason, and the most that was needed."""
    if overflows:
        reason = tl.load(guard + REASON)
        tl.store(guard + REASON, tl.where(reason == 0, OVERFLOW, reason))
        most = tl.maximum(tl.load(guard + NEEDED).to(tl.int64), needed)
        tl.store(guard + NEEDED, tl.minimum(most, 2147483647).to(tl.int32))


@triton.jit(do_not_specialize=["capacity", "splats", "count", "tiles_x", "tiles_y", "tile_zero", "tiles"])
def _deal_hits(
    records,
    order,
    starts,
    tile_of_hit,
    splat_of_hit,
    capacity,
    splats,
    count,
    tiles_x,
    tiles_y,
    tile_zero,
    tiles,
    guard,
    BLOCK: tl.constexpr,
):
    """Write tile and splat of every hit; the tile is ``tiles`` where there is none or the ellipse misses.

    Tiles count from ``tile_zero`` on.
    """
    program = tl.program_id(0)
    needed = tl.load(starts + splats)
    if guard is not None:
        _set_guard(guard, needed, (program == 0) & (needed > capacity))
    begin = program * BLOCK
    numbers = begin + tl.arange(0, BLOCK)
    end = tl.minimum(needed, capacity).to(tl.int32)
    if begin < end:
        # Neighbours are hits of the same few splats: most of the search is the same for all of them.
        first = _place_of(begin, starts, tl.cast(0, tl.int32), splats, splats)
        last = _place_of(tl.minimum(begin + BLOCK, end) - 1, starts, first, splats, splats - first)
        low, high = tl.zeros_like(numbers) + first, tl.zeros_like(numbers) + last + 1
        place = _place_of(numbers, starts, low, high, last + 1 - first)
        camera = place // count
        splat = camera * count + tl.load(order + place).to(tl.int32)
        record = records + splat.to(tl.int64) * RECORD
        first_column, end_column, first_row, _ = tile_box(record, numbers < end, tiles_x, tiles_y)
        within = numbers - tl.load(starts + place).to(tl.int32)
        columns = tl.maximum(end_column - first_column, 1)
        row = first_row + within // columns
        column = first_column + within % columns

        top = row.to(tl.float32) * TILE_H - tl.load(record + CENTER_Y) - SLACK
        bottom = top + (TILE_H + 2.0 * SLACK)
        rightmost = tl.load(record + SLOPE_Y) * tl.load(record + EXTENT_X)
        left, right = ellipse_span(
            top,
            bottom,
            tl.load(record + EXTENT_Y),
            rightmost,
            tl.load(record + WIDTH),
            tl.load(record + SLOPE_X),
        )
        x = tl.load(record + CENTER_X)
        first_hit, end_hit = tile_range(x + left, x + right, end_column, TILE_W)
        is_hit = (numbers < end) & (column >= first_hit) & (column < end_hit)
        tile = tl.where(is_hit, (camera * tiles_y + row) * tiles_x + column, tiles)
        tl.store(tile_of_hit + numbers, tile_zero + tile, mask=numbers < capacity)
        tl.store(splat_of_hit + numbers, splat, mask=numbers < capacity)
    else:
        nothing = tl.zeros((BLOCK,), tl.int32)
        tl.store(tile_of_hit + numbers, nothing + tile_zero + tiles, mask=numbers < capacity)
        tl.store(splat_of_hit + numbers, nothing, mask=numbers < capacity)


@triton.jit(do_not_specialize=["capacity", "listed_size"])
def _list_hits(hit_of_slot, splat_of_hit, listed, numbers, capacity, listed_size, BLOCK: tl.constexpr):
    """Write number and splat of the hit in every slot, and splat 0 behind the last one."""
    slots = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = slots < capacity
    number = tl.load(hit_of_slot + slots, mask=inside, other=0)
    splat = tl.load(splat_of_hit + number, mask=inside, other=0)
    tl.store(listed + slots, splat, mask=slots < listed_size)
    tl.store(numbers + slots, number.to(tl.int32), mask=inside)
