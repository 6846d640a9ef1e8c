"""The selectors by name. Adding one is a file here and a line in the table."""

from collections.abc import Callable, Mapping

from fvs_engine.errors import InvalidInputError
from fvs_engine.select.interface import Selector
from fvs_engine.select.selectors.coverage import Coverage
from fvs_engine.select.selectors.d_optimal import d_optimal
from fvs_engine.select.selectors.farthest import Farthest
from fvs_engine.select.selectors.fisher import fisher
from fvs_engine.select.selectors.median_frequency import median_frequency
from fvs_engine.select.selectors.nearest import Nearest
from fvs_engine.select.selectors.random_order import RandomOrder
from fvs_engine.select.selectors.spectral_median import spectral_median
from fvs_engine.select.selectors.uniform import Uniform

SELECTORS: Mapping[str, Callable[[], Selector]] = {
    "median-frequency": median_frequency,
    "random": RandomOrder,
    "uniform": Uniform,
    "farthest": Farthest,
    "nearest": Nearest,
    "fisher": fisher,
    "d-optimal": d_optimal,
    "coverage": Coverage,
    "spectral-median": spectral_median,
}


def create_selector(name: str) -> Selector:
    """Create a selector by name. Raises ``InvalidInputError``, naming all of them, for another name."""
    try:
        factory = SELECTORS[name]
    except KeyError:
        raise InvalidInputError(
            f"There is no selector {name!r}.", hint=f"Choose one of {', '.join(SELECTORS)}."
        ) from None
    return factory()
