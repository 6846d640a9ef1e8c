"""Degrees of spherical harmonics, for whoever has no use for torch."""


def sh_coefficient_count(degree: int) -> int:
    """Number of spherical-harmonics coefficients per colour channel up to ``degree``."""
    return (degree + 1) ** 2
