"""The candidates that a plan considers, so that its time is bounded."""

from fvs_engine.plan.sample import even_sample
from fvs_engine.views import PinholeView

_MOST_PRODUCTS = 200**3 * 2_000
"""Maximum number of candidates times the cube of the number of views, which the time of a plan follows."""


def considered(candidates: tuple[PinholeView, ...], views: int, most: int) -> tuple[PinholeView, ...]:
    """Those of ``candidates`` that a plan of so many ``views`` considers: of very many, an even share.

    At most ``most``. Of 100,000, up to 54 views are chosen among all, 100 among 16,000, 200 among 2,000.
    """
    kept = even_sample(len(candidates), min(most, _MOST_PRODUCTS // views**3))
    return tuple(candidates[index] for index in kept)
