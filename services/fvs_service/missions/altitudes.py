"""Altitudes above the ellipsoid, sea level and home, and their conversion."""

from collections.abc import Container
from dataclasses import dataclass

from fvs_schema.scenes import AltitudeDatum
from fvs_service.errors import InvalidRequestError

_ABSOLUTE = frozenset({AltitudeDatum.ELLIPSOID, AltitudeDatum.SEA_LEVEL})


@dataclass(frozen=True)
class Altitudes:
    """Converts altitudes of a scene, which are above ``datum``.

    ``home_m`` is home's altitude above the same datum; ``geoid_m`` the geoid's height over the ellipsoid.
    None where it is not known.
    """

    datum: AltitudeDatum
    home_m: float | None
    geoid_m: float | None

    @classmethod
    def of(cls, datum: AltitudeDatum, home_m: float | None, geoid_m: float | None) -> "Altitudes":
        """The conversion of a scene: above takeoff, home is at 0 unless it is given."""
        return cls(datum, 0.0 if home_m is None and datum is AltitudeDatum.TAKEOFF else home_m, geoid_m)

    def height(self, altitude_m: float) -> float | None:
        """The height above home; None when home's altitude is not known."""
        return None if self.home_m is None else altitude_m - self.home_m

    def offset(self, target: AltitudeDatum) -> float | None:
        """The offset from an altitude to that above ``target``; None when it is not known."""
        if target is AltitudeDatum.TAKEOFF:
            return None if self.home_m is None else -self.home_m
        if target is self.datum:
            return 0.0
        if self.geoid_m is None or self.datum is AltitudeDatum.TAKEOFF:
            return None
        return self.geoid_m if target is AltitudeDatum.ELLIPSOID else -self.geoid_m

    def choose(
        self, wanted: AltitudeDatum | None, possible: Container[AltitudeDatum], what: str
    ) -> AltitudeDatum:
        """The datum of a file: the ``wanted`` one, else home's, else the scene's, else any that is known.

        Raises ``InvalidRequestError`` when the format has no such datum, or it is not known.
        """
        order = (AltitudeDatum.TAKEOFF, self.datum, AltitudeDatum.SEA_LEVEL, AltitudeDatum.ELLIPSOID)
        if wanted is not None:
            if wanted not in possible:
                have = ", ".join(f"altitude_datum={one.value}" for one in AltitudeDatum if one in possible)
                raise InvalidRequestError(
                    f"{what} has no altitudes above {wanted.in_words}.", hint=f"It can have {have}."
                )
            order = (wanted, wanted, wanted, wanted)
        for datum in order:
            if datum in possible and self.offset(datum) is not None:
                return datum
        raise InvalidRequestError(
            f"The scene's altitudes are above {self.datum.in_words}, and cannot be converted for {what}.",
            hint=self._remedy(wanted, possible),
        )

    def _remedy(self, wanted: AltitudeDatum | None, possible: Container[AltitudeDatum]) -> str:
        if self.datum is AltitudeDatum.TAKEOFF:
            related = "nothing relates this scene to another datum."
            if AltitudeDatum.TAKEOFF not in possible:
                return f"Choose a format that has altitudes above home: {related}"
            return f"Ask for altitude_datum=takeoff: {related}"
        home = f"home_altitude_m, the altitude of the place of takeoff above {self.datum.in_words}"
        geoid = "geoid_height_m, the height of the geoid above the ellipsoid at the site"
        if wanted is AltitudeDatum.TAKEOFF:
            return f"Give {home}."
        if wanted in _ABSOLUTE or AltitudeDatum.TAKEOFF not in possible:
            return f"Give {geoid}."
        return f"Give {home}, or {geoid}."
