"""Records of plans: what is planned, and what to expect. Imports nothing heavy."""

from fvs_engine.records import Record
from fvs_schema.findings import Finding

COVERAGE = 0.8
"""Probability of the interval that a forecast gives."""
_LAST_STOPS = 5


class Forecast(Record):
    """The expected mean PSNR over the targets, and an interval that holds it in ``COVERAGE`` of all cases."""

    db: float
    low_db: float
    high_db: float


class Expectation(Record):
    """The mean kriging variance over the targets, and the PSNR to expect of them.

    ``forecast`` is None as long as too few photographs were seen.
    """

    variance: float
    forecast: Forecast | None


class Outlook(Record):
    """What to expect ``now``, after the view that gains most in reach, and at the ``end`` of the best plan.

    ``gain_db`` is what the next view adds; None without a forecast.
    """

    now: Expectation
    after_next: Expectation
    end: Expectation
    gain_db: float | None


class Term(Record):
    """Why a candidate is, or is not, worth a visit.

    ``gain``: by how much it alone would lower the mean variance, and ``gain_in_plan`` beside all other
    planned views (of a planned one: the loss without it). ``variance`` is that of its own pose,
    ``distance`` that from the nearest vehicle (None: no way leads there), ``chance`` the probability that it
    is registered (None: poses are known). ``helps``: indices of the targets that gain most. ``coverage`` and
    ``median_frequency`` are what the model shows of it, estimated (None: not of all terms, and the latter not
    where nothing is in view).
    """

    name: str
    planned: bool
    gain: float
    gain_in_plan: float
    variance: float
    distance: float | None
    chance: float | None
    helps: tuple[int, ...]
    coverage: float | None = None
    median_frequency: float | None = None


class Stop(Record):
    """A planned view: ``distance`` from the stop before, ``travel`` since the start, and what it leaves.

    ``via``: positions to pass on the way to it, where something is in the straight line.
    """

    name: str
    distance: float
    travel: float
    after: Expectation
    via: tuple[tuple[float, float, float], ...] = ()


class VehicleTour(Record):
    """The stops of one vehicle, and the length of its way, home included where that was asked for.

    ``via_home``: positions to pass on the way home, as ``via`` of a stop.
    """

    start: tuple[float, float, float]
    stops: tuple[Stop, ...]
    length: float
    via_home: tuple[tuple[float, float, float], ...] = ()


class Plan(Record):
    """Tours, what to expect ``now`` and at the ``end``, and the terms of candidates, planned ones first.

    What a stop brings assumes that all tours are flown at the same speed. ``targets`` are the names of the
    poses that the model must serve, and ``target_variances`` their variances before and after.
    ``registrable``: how many candidates are likely to be registered now (None: poses are known).
    ``warnings``: which vehicles have no tour because they cannot fly, which candidates could not be planned,
    and whether the planned ones show nothing.
    """

    now: Expectation
    end: Expectation
    tours: tuple[VehicleTour, ...]
    terms: tuple[Term, ...]
    targets: tuple[str, ...]
    target_variances: tuple[tuple[float, float], ...]
    registrable: int | None = None
    warnings: tuple[Finding, ...] = ()

    @property
    def stops(self) -> int:
        """Planned views of all vehicles."""
        return sum(len(tour.stops) for tour in self.tours)

    @property
    def length(self) -> float:
        """The length of all tours."""
        return sum(tour.length for tour in self.tours)

    def sentence(self, unit: str, scale: float = 1.0) -> str:
        """The plan in a sentence for a pilot; ``scale``: units per unit of the model frame."""
        count = _plural(self.stops, "more photograph")
        flight = f"{count}, {self.length * scale:.3g} {unit} of flight"
        if self.end.forecast is None or self.now.forecast is None:
            known = 1 - self.end.variance / self.now.variance if self.now.variance > 0 else 0.0
            return f"{flight}: the mean variance falls by {known:.0%}."
        text = f"{flight}, for {self.end.forecast.db:.1f} dB instead of {self.now.forecast.db:.1f}"
        order = self._by_travel()
        last = min(_LAST_STOPS, len(order) - 1)
        if last < 1:
            return f"{text}."
        before, after = order[-last - 1].after.forecast, order[-1].after.forecast
        assert before is not None
        assert after is not None
        each = (after.db - before.db) / last
        return f"{text}; " + (
            f"the last {last} gain {each:.2g} dB each." if last > 1 else f"the last gains {each:.2g} dB."
        )

    def _by_travel(self) -> list[Stop]:
        return sorted((stop for tour in self.tours for stop in tour.stops), key=lambda stop: stop.travel)


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
