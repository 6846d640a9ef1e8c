"""The selectors that the product is compared with, and the table of all selectors by name."""

from collections.abc import Callable, Mapping

from fvs_engine.errors import InvalidInputError
from fvs_engine.lab.baselines.coverage import Coverage
from fvs_engine.lab.baselines.distance import Farthest, Nearest
from fvs_engine.lab.baselines.information_gain import d_optimal, fisher
from fvs_engine.lab.baselines.random_order import RandomOrder
from fvs_engine.lab.baselines.uniform import Uniform
from fvs_engine.score.selectors.interface import Selector
from fvs_engine.score.selectors.kriging import Kriging
from fvs_engine.score.selectors.renders import (
    median_frequency,
    median_frequency_estimate,
    median_frequency_fast,
    spectral_median,
)
from fvs_schema.words import Method

SELECTORS: Mapping[Method, Callable[[], Selector]] = {
    "median-frequency": median_frequency,
    "median-frequency-fast": median_frequency_fast,
    "median-frequency-estimate": median_frequency_estimate,
    "random": RandomOrder,
    "uniform": Uniform,
    "farthest": Farthest,
    "nearest": Nearest,
    "kriging": Kriging,
    "fisher": fisher,
    "d-optimal": d_optimal,
    "coverage": Coverage,
    "spectral-median": spectral_median,
}


def create_selector(name: str) -> Selector:
    """Create a selector by name. Raises ``InvalidInputError``, naming all of them, for another name."""
    for known, create in SELECTORS.items():
        if known == name:
            return create()
    raise InvalidInputError(f"There is no selector {name!r}.", hint=f"Choose one of {', '.join(SELECTORS)}.")
