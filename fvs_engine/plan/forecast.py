"""From kriging variance to PSNR: what quality to expect now, after the next view and after a plan.

Source: Bayesian linear regression with a normal-inverse-gamma prior (Murphy, "Machine Learning", 2012,
section 7.6.3). Its data are photographs of the scene itself: the PSNR of each before it was trained on, and
the variance of its pose at that time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from fvs_engine.plan.plan_records import COVERAGE, Forecast

Array = NDArray[np.float64]

LEAST_PHOTOGRAPHS = 3
"""Minimum number of photographs for a forecast: before, the quality level of a scene is unknown."""

_SLOPE_DB, _SLOPE_SD_DB = 25.0, 10.0
"""Loss in dB per unit of variance: 27 to 34 over sets of views of four scenes (docs/design/planning.md)."""
_LEVEL_DB, _LEVEL_SD_DB = 35.0, 12.0
"""PSNR at zero variance; the standard deviation is that between scenes."""
_SD_DB = 2.0
"""Standard deviation of the PSNR of single views around the line."""
_MODEL_SHARE = 0.1
"""Share of that variance that all views of one model have in common."""
_BIAS_SD_DB = 2.0
"""Standard deviation of the common bias of chosen views: they are no fair sample, however many there are.

Forecasts are too low with ``median-frequency`` and too high with ``farthest``. With this bias 91 % of the
intervals hold, on three scenes, of which 80 % should (docs/design/planning.md)."""
_PRIOR_WEIGHT = 4.0
"""Number of views that the prior of the deviation is worth."""


@dataclass(frozen=True)
class Seen:
    """A photograph before it was trained on: the ``variance`` of its pose, and the PSNR of its render."""

    variance: float
    psnr_db: float


class PsnrForecast:
    """Regression of PSNR on variance over the photographs, with a prior from other scenes."""

    def __init__(self, seen: Sequence[Seen]) -> None:
        rows = np.array([[1.0, -view.variance] for view in seen]).reshape(-1, 2)
        values = np.array([view.psnr_db for view in seen])
        mean = np.array([_LEVEL_DB, _SLOPE_DB])
        precision = np.diag([(_SD_DB / _LEVEL_SD_DB) ** 2, (_SD_DB / _SLOPE_SD_DB) ** 2])
        self._precision = precision + rows.T @ rows
        self._line = np.linalg.solve(self._precision, precision @ mean + rows.T @ values)
        self._freedom = _PRIOR_WEIGHT + len(seen)
        squares = (
            _PRIOR_WEIGHT * _SD_DB**2
            + values @ values
            + mean @ precision @ mean
            - self._line @ self._precision @ self._line
        )
        self._squared_sd = float(squares) / self._freedom

    def at(self, mean_variance: float) -> Forecast:
        """The mean PSNR to expect over targets with this mean variance."""
        return self._at(np.array([mean_variance]), _MODEL_SHARE)[0]

    def of_views(self, variances: Array) -> tuple[Forecast, ...]:
        """The PSNR to expect of each of some single views, which have these variances [V]."""
        return self._at(variances, 1.0)

    def _at(self, variances: Array, share: float) -> tuple[Forecast, ...]:
        """Forecasts of views that deviate from the line by this share of the variance of single ones."""
        rows = np.stack([np.ones(len(variances)), -variances], axis=1)
        expected = rows @ self._line
        uncertain = np.einsum("vi,iv->v", rows, np.linalg.solve(self._precision, rows.T))
        width = float(student_t.ppf(0.5 + COVERAGE / 2, self._freedom))
        margins = width * np.sqrt(self._squared_sd * (uncertain + share) + _BIAS_SD_DB**2)
        ends = np.stack([expected, expected - margins, expected + margins], axis=1)
        return tuple(Forecast(db=db, low_db=low, high_db=high) for db, low, high in ends.tolist())

    def gain_db(self, variance: float, variance_after: float) -> float:
        """The rise of the mean PSNR for a fall of the mean variance."""
        return float(self._line[1] * (variance - variance_after))
