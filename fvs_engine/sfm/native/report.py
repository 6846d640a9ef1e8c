"""How a native job reports its progress."""

from collections.abc import Callable

Report = Callable[[int], None]
"""Called with the number of items that are done."""
