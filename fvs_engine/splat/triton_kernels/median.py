"""The two middle |F|² of images' spectra, exact, from the half that a real image's FFT computes.

A positive float32 read as an integer keeps its order. Its 31 bits are found eight at a time: every program
counts the next digits of its share of the coefficients whose bits so far are those of the answer, and one
program per image adds the counts up and finds the digit at the rank. The two middle ones are neighbours and
nearly always have the same digits; where they part, each has its own counts. Counts are of integers, so the
order does not matter.

A coefficient stands for two of the full spectrum, except in column 0 and, where the width is even, in the
last: those edges are counted by a program of their own, which takes one of the two away.

Per coefficient 16 bytes are read (float64) and 4 written, then three times 4 read: 32.
"""

import torch
import triton
import triton.language as tl
from torch import Tensor

POSITIVE = tl.constexpr(0x7FFFFFFF)
DIGITS = tl.constexpr(256)
NOT_FINITE = tl.constexpr(255)  # the first digit, the exponent, of infinity and NaN

_SHIFTS = (23, 15, 7, 0)
_BITS = 31
_BLOCK = 1024
_PROGRAMS = 64
"""At most so many per image count its coefficients."""
_WARPS = 4
_STATE = 4
"""Per image: the bits so far of both, and their ranks among the coefficients that have them; < 0: NaN."""


@triton.jit(do_not_specialize=["pixels", "channels"])
def clamped_planes(images, planes, pixels, channels, BLOCK: tl.constexpr):
    """Images [B, pixels, C] in [0, 1] as float64 [B, C, pixels]; NaN stays."""
    pixel = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    inside = pixel < pixels
    image = tl.program_id(1).to(tl.int64) * channels * pixels
    for channel in range(channels):
        value = tl.load(images + image + pixel * channels + channel, mask=inside, other=0.0).to(tl.float64)
        value = tl.where(value < 0, 0.0, tl.where(value > 1, 1.0, value))
        tl.store(planes + image + pixel, value, mask=inside)
        planes += pixels


@triton.jit(do_not_specialize=["coefficients", "edges", "length", "shift", "bits"])
def count_digits(
    half, powers, states, counts, coefficients, edges, length, shift, bits,
    FIRST: tl.constexpr, EDGE_COLUMNS: tl.constexpr, BINS: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Count the digits above ``shift`` of one share of an image's |F|², [programs, BINS] per image.

    The ``FIRST`` time squares ``half`` into ``powers``, as bits. The last program counts the edges.
    """
    program = tl.program_id(0)
    shares = tl.num_programs(0) - 1
    image = tl.program_id(1).to(tl.int64)
    powers += image * coefficients
    half += 2 * image * coefficients
    of_edges = program == shares
    end = tl.where(of_edges, edges, coefficients)
    first = tl.where(of_edges, 0, program * BLOCK)
    stride = tl.where(of_edges, BLOCK, shares * BLOCK)
    found = tl.zeros([BINS], tl.int32)
    for start in range(first, end, stride):
        i = start + tl.arange(0, BLOCK)
        counted = i < end
        edge = (i // EDGE_COLUMNS) * length + (i % EDGE_COLUMNS) * (length - 1)
        i = tl.where(of_edges, edge, i)
        if FIRST:
            real = tl.load(half + 2 * i, mask=counted, other=0.0).to(tl.float64)
            imaginary = tl.load(half + 2 * i + 1, mask=counted, other=0.0).to(tl.float64)
            power = (real * real + imaginary * imaginary).to(tl.float32)
            number = power.to(tl.int32, bitcast=True) & POSITIVE
            tl.store(powers + i, number, mask=counted)
            digit = number >> shift
        else:
            number = tl.load(powers + i, mask=counted, other=0)
            before, before_other = tl.load(states + 4 * image), tl.load(states + 4 * image + 1)
            prefix = number >> (shift + bits)
            is_other = (prefix == before_other) & (prefix != before)
            digit = ((number >> shift) & ((1 << bits) - 1)) + tl.where(is_other, BINS // 2, 0)
            counted &= (prefix == before) | is_other
        found += tl.histogram(digit, BINS, mask=counted)
    out = counts + (image * (shares + 1) + program) * BINS + tl.arange(0, BINS)
    tl.store(out, tl.where(of_edges, -found, 2 * found))


@triton.jit(do_not_specialize=["programs", "rank", "rank_other", "bits"])
def find_digits(
    counts, states, found_states, programs, rank, rank_other, bits,
    FIRST: tl.constexpr, BINS: tl.constexpr,
):  # fmt: skip
    """Add up an image's counts, find the digit at either rank, and the rank among those that have it."""
    image = tl.program_id(0).to(tl.int64)
    index = tl.arange(0, BINS)
    total = tl.zeros([BINS], tl.int32)
    for program in range(programs):
        total += tl.load(counts + (image * programs + program) * BINS + index)
    for k in tl.static_range(2):
        if FIRST:
            before = 0
            part = 0
            finite = tl.sum(tl.where(index == NOT_FINITE, total, 0)) == 0
            place = tl.where(finite, rank if k == 0 else rank_other, -1)
        else:
            before = tl.load(states + 4 * image + k)
            part = tl.where(before == tl.load(states + 4 * image), 0, 1)
            place = tl.load(states + 4 * image + 2 + k)
        mine = index // DIGITS == part
        own = tl.where(mine, total, 0)
        digit = tl.sum(tl.where(mine & (tl.cumsum(own) <= place), 1, 0))
        below = tl.sum(tl.where(index % DIGITS < digit, own, 0))
        digit = tl.where(place < 0, (1 << bits) - 1, digit)
        place = tl.where(place < 0, place, place - below)
        tl.store(found_states + 4 * image + k, (before << bits) | digit)
        tl.store(found_states + 4 * image + 2 + k, place)


def planes_of(images: Tensor) -> Tensor:
    """Images [B, H, W, C], clamped to [0, 1], as float64 [B, C, H, W]: what the FFT takes."""
    batch, height, width, channels = images.shape
    planes = images.new_empty((batch, channels, height, width), dtype=torch.float64)
    grid = (triton.cdiv(height * width, _BLOCK), batch)
    clamped_planes[grid](images.contiguous(), planes, height * width, channels, BLOCK=_BLOCK)
    return planes


def middle_powers(half: Tensor, width: int) -> Tensor:
    """The |F|² in the middle of each image's full spectrum: float32 [B, 2], ascending. Waits for nothing.

    ``half`` [B, C, H, W // 2 + 1] complex: ``torch.fft.rfft2`` of images ``width`` px wide. The two are the
    same where the count of coefficients is odd. NaN where a coefficient is not finite.
    """
    batch, channels, height, length = half.shape
    lines = channels * height
    coefficients, edge_columns = lines * length, 2 - width % 2
    programs = min(_PROGRAMS, triton.cdiv(coefficients, _BLOCK)) + 1
    parts = torch.view_as_real(half.contiguous())
    powers = torch.empty((batch, coefficients), dtype=torch.int32, device=half.device)
    counts = powers.new_empty((batch, programs, 2 * DIGITS.value))
    states = powers.new_empty((len(_SHIFTS) + 1, batch, _STATE))
    ranks = ((lines * width - 1) // 2, lines * width // 2)
    above = _BITS
    for step, shift in enumerate(_SHIFTS):
        bits, above = above - shift, shift
        meta = {"FIRST": step == 0, "BINS": (1 if step == 0 else 2) * DIGITS.value, "num_warps": _WARPS}
        count_digits[(programs, batch)](
            parts, powers, states[step], counts, coefficients, lines * edge_columns, length, shift, bits,
            EDGE_COLUMNS=edge_columns, BLOCK=_BLOCK, **meta,
        )  # fmt: skip
        find_digits[(batch,)](counts, states[step], states[step + 1], programs, *ranks, bits, **meta)
    return states[-1, :, :2].view(torch.float32)
