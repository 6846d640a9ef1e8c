"""A simulated vehicle and a ground station."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from simulators import flown_by_station


@pytest.fixture
def flown(tmp_path: Path) -> Callable[..., AbstractContextManager[Any]]:
    """Run a simulator and a station in a ``with`` block."""
    return partial(flown_by_station, tmp_path)
