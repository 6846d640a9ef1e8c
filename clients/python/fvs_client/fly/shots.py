"""The photographs of a flight: which of its triggers have one, as reports and files come."""

from collections.abc import Sequence

from fvs_client import Candidate
from fvs_client.fly.captures import Capture
from fvs_client.fly.log import FlightLog
from fvs_client.fly.matching import Shot, shot_of
from fvs_client.fly.photographs import Photographs
from fvs_client.fly.telemetry import VehicleState
from fvs_client.fly.vehicle import Vehicle

_HELD = 30
"""Number of looks, ten a second: photographs may be known before the vehicle says how far its mission is.
Time would also pass while this program does not run, and hears nothing."""


class Shots:
    """The triggers of all legs of a flight, and their photographs; ``wanted`` is how many."""

    def __init__(self, vehicle: Vehicle, photographs: Photographs, wanted: int, log: FlightLog) -> None:
        self._vehicle, self._photographs = vehicle, photographs
        self._wanted, self._log = wanted, log
        self._all: list[Shot] = []
        """In the order of the legs."""
        self._held: list[tuple[int, Capture]] = []
        """Reports of no trigger that the mission is known to have reached, and how many looks are left."""
        self.late: list[Candidate] = []
        """The views whose photographs came after they were reported as failed."""

    def add(self, shots: Sequence[Shot]) -> None:
        """Add the triggers of a new leg."""
        self._all += shots

    @property
    def reported(self) -> list[Shot]:
        """Those of which anything is known."""
        return [shot for shot in self._all if shot.reported]

    @property
    def taken(self) -> int:
        """Number of photographs that have arrived."""
        return sum(shot.arrived for shot in self._all)

    @property
    def failed(self) -> int:
        """Number of those that have none."""
        return sum(shot.failed for shot in self._all)

    def collect(self, state: VehicleState) -> bool:
        """Assign the new reports of photographs and the files that have come; whether there were any."""
        new = [(_HELD, capture) for capture in (*self._vehicle.captures(), *self._photographs.arrived())]
        held, self._held = self._held, []
        for looks, capture in (*held, *new):
            shot = shot_of(capture, self._all)
            if shot is None:
                if looks:
                    self._held.append((looks - 1, capture))
                continue
            arrived, failed, reported = shot.arrived, shot.failed, shot.reported
            shot.reports[capture.source] = capture
            if not reported:
                self._event("captured", "", shot, state)
            if shot.arrived and not arrived:
                text = f"Photograph {self.taken} of {self._wanted}."
                if shot.over:
                    text += " It came late."
                    self.late += [] if shot.view is None else [shot.view]
                self._event("photograph", text, shot, state)
            elif shot.failed and not failed:
                where = "" if shot.view is None else f" at {shot.view.id}"
                who = "The service refuses the photograph" if arrived else "The camera reports a failure"
                self._event("failed", f"{who}{where}.", shot, state)
        return bool(new)

    def close(self, shots: Sequence[Shot], state: VehicleState) -> None:
        """Wait no longer for photographs; say which did not come."""
        missing = [shot for shot in shots if not (shot.arrived or shot.failed)]
        for shot in shots:
            shot.over = True
        if missing:
            files = sum(shot.reported for shot in missing)
            text = f"{len(missing)} photographs did not come"
            if files:
                text += f": {files} were reported, but their files are not in {self._photographs.folder}"
            self._log.event("failed", f"{text}.", state)

    def _event(self, kind: str, text: str, shot: Shot, state: VehicleState) -> None:
        """Log an event where the photograph was taken: the vehicle flies on before it is reported."""
        details: dict[str, object] = {} if shot.view is None else {"candidate": shot.view.id}
        said = shot.said
        if said is not None and said.place is not None:
            latitude_deg, longitude_deg = said.place
            details |= {
                "latitude_deg": latitude_deg,
                "longitude_deg": longitude_deg,
                "height_m": said.height_m,
            }
        file = next((report.file for report in shot.reports.values() if report.file), "")
        self._log.event(kind, text, state, file=file, **details)
