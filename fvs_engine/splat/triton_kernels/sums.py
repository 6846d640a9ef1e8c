"""Add up the rows of every splat's hits, in an order that depends on nothing but their number.

Bytes: reads 4 per number of a row, once, and 24 per splat; writes a row per splat.
"""

import triton
import triton.language as tl
from torch import Tensor

from fvs_engine.splat.triton_kernels.binning import Hits

SPLATS, LANES = 16, 2  # of a program: so many splats at once, and so many hits of each
FEW = tl.constexpr(32)
"""What a splat has more hits than that is added up after all others, ``MANY`` hits at once."""
MANY = tl.constexpr(64)


def sum_hits(rows: Tensor, hits: Hits) -> Tensor:
    """The sums [C, N, K] of ``rows`` [capacity, K], K ≤ 16, by splat; 0 for a splat without hits.

    Hits beyond the capacity are left out.
    """
    cameras, count = hits.order.shape
    sums = rows.new_empty((cameras, count, rows.shape[1]))
    if cameras * count > 0:
        sum_hits_kernel[(triton.cdiv(cameras * count, SPLATS),)](
            rows, hits.starts, hits.order, sums, cameras * count, count, hits.capacity,
            COLUMNS=rows.shape[1], SPLATS=SPLATS, LANES=LANES, num_warps=1,
        )  # fmt: skip
    return sums


@triton.jit(do_not_specialize=["places", "count", "capacity"])
def sum_hits_kernel(
    rows, starts, order, sums, places, count, capacity,
    COLUMNS: tl.constexpr, SPLATS: tl.constexpr, LANES: tl.constexpr,
):  # fmt: skip
    """One program adds up ``SPLATS`` neighbours in depth order: they have about as many hits."""
    place = tl.program_id(0) * SPLATS + tl.arange(0, SPLATS)
    inside = place < places
    # The capacity is an int32 number, and with it all that is less.
    start = tl.minimum(tl.load(starts + place, mask=inside, other=0), capacity).to(tl.int32)
    end = tl.minimum(tl.load(starts + place + 1, mask=inside, other=0), capacity).to(tl.int32)
    columns = tl.arange(0, 16)
    known = columns < COLUMNS
    most = tl.max(end - start, axis=0)
    total = tl.zeros((SPLATS, LANES, 16), tl.float32)
    for first in range(0, tl.minimum(most, FEW), LANES):
        hit = start[:, None] + first + tl.arange(0, LANES)[None, :]
        row = rows + hit.to(tl.int64)[:, :, None] * COLUMNS + columns[None, None, :]
        total += tl.load(row, mask=(hit < end[:, None])[:, :, None] & known[None, None, :], other=0.0)
    result = tl.sum(total, axis=1)
    if most > FEW:
        for number in range(SPLATS):
            chosen = tl.arange(0, SPLATS) == number
            last = tl.sum(tl.where(chosen, end, 0), axis=0)
            rest = tl.zeros((MANY, 16), tl.float32)
            for first in range(tl.sum(tl.where(chosen, start, 0), axis=0) + FEW, last, MANY):
                hit = first + tl.arange(0, MANY)
                row = rows + hit.to(tl.int64)[:, None] * COLUMNS + columns[None, :]
                rest += tl.load(row, mask=(hit < last)[:, None] & known[None, :], other=0.0)
            result += tl.where(chosen[:, None], tl.sum(rest, axis=0)[None, :], 0.0)
    splat = place // count * count + tl.load(order + place, mask=inside, other=0).to(tl.int32)
    at = sums + splat.to(tl.int64)[:, None] * COLUMNS + columns[None, :]
    tl.store(at, result, mask=inside[:, None] & known[None, :])
