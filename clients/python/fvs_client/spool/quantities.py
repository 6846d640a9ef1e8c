"""Sizes and rates as people write them."""

import re

_UNITS = {"": 1, "k": 1_000, "m": 1_000_000, "g": 1_000_000_000, "t": 1_000_000_000_000}
_WRITTEN = re.compile(r"(\d+(?:\.\d+)?)\s*([kmgt]?)b?", re.IGNORECASE)


def bytes_of(text: str) -> int:
    """Bytes in ``500``, ``64kB``, ``1.5MB`` or ``8G``, with decimal units. Raises ``ValueError``."""
    found = _WRITTEN.fullmatch(text.strip())
    size = 0 if found is None else int(float(found[1]) * _UNITS[found[2].lower()])
    if size < 1:
        raise ValueError(f"{text!r} is not a size; examples are 64kB, 1.5MB and 8GB")
    return size
