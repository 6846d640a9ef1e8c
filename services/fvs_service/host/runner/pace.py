"""The measured pace of rankings and renders, from which waiting times are estimated."""

_WEIGHT = 0.3
"""Weight of the newest measurement in the moving average."""


class Pace:
    """Seconds per view by kind (a method, or ``render``): a moving average of what was measured."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}

    def add(self, kind: str, views: float, seconds: float) -> None:
        """Add a measurement: ``views`` took ``seconds``."""
        if views <= 0:
            return
        measured = seconds / views
        before = self._seconds.get(kind, measured)
        self._seconds[kind] = before + _WEIGHT * (measured - before)

    def expected_s(self, kind: str, views: int) -> float:
        """The expected time of ``views``: as the slowest kind while this one is unknown, 0 while all are."""
        seconds = self._seconds.get(kind)
        if seconds is None:
            seconds = max(self._seconds.values(), default=0.0)
        return seconds * views
