"""Rows of values that a thread holds one by one, for kernels: a row is read and written as a whole."""

import triton
import triton.language as tl


@triton.jit
def row_of_4(a, b, c, d):
    """Rows [B, 4] of four columns [B]."""
    return tl.reshape(tl.join(tl.join(a, c), tl.join(b, d)), (a.shape[0], 4))


@triton.jit
def row_of_16(a, b, c, d, e, f, g, h, i, j, k, m, n, o, p, q):
    """Rows [B, 16] of sixteen columns [B]."""
    first, second = row_of_4(a, e, i, n), row_of_4(b, f, j, o)
    third, fourth = row_of_4(c, g, k, p), row_of_4(d, h, m, q)
    return tl.reshape(tl.join(tl.join(first, third), tl.join(second, fourth)), (a.shape[0], 16))
