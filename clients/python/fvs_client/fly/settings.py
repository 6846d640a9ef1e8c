"""Settings and result of a flight."""

from dataclasses import dataclass, field
from enum import StrEnum

from fvs_client import Candidate
from fvs_client.fly.survey import Survey
from fvs_client.height_model import HeightModel
from fvs_client.models.missions import MissionSettings
from fvs_schema.candidates import Generator


class Ending(StrEnum):
    """Why a flight ended."""

    BUDGET = "budget"
    """All photographs are taken."""
    BATTERY = "battery"
    STOPPED = "stopped"
    """It was asked to return home."""
    GOOD_ENOUGH = "good-enough"
    """The expected PSNR has reached its goal."""
    NO_VIEW = "no-view"
    """No candidate can be flown to."""
    CAMERA = "camera"
    """The camera takes no photographs."""
    SERVICE = "service"
    """The service could not be reached, or made no model, until the vehicle had to return."""
    VEHICLE = "vehicle"
    """The vehicle refused something, or returned by itself."""
    PILOT = "pilot"
    """A pilot, or another ground station, has taken over."""
    FAILED = "failed"
    """The disk, the spool or this program failed."""


@dataclass(frozen=True)
class FlightSettings:
    """Settings of a flight."""

    vehicle: str
    """The vehicle's name, by which others leave its views out."""
    photographs: int
    """Number of photographs, with those of the survey."""
    method: str = "median-frequency"
    generator: Generator | None = None
    candidates: tuple[Candidate, ...] | None = None
    radius_m: float | None = None
    """Maximum distance of views from the vehicle in the air: the way from home may be longer."""
    leg_views: int = 1
    """Number of views that are photographed before the next update: more than one are planned together."""
    safety_m: float | None = None
    """Distance of planned legs (with ``leg_views``) and candidates of a volume from matter."""
    survey: Survey | None = None
    """The first photographs, for a scene without a model."""
    reserve: float = 0.3
    """The share of the battery with which it returns home."""
    patience_s: float = 300.0
    """How long the vehicle waits for the next mission before it returns home."""
    photograph_s: float = 60.0
    """How long a photograph may take, once the vehicle is there."""
    leg_s: float = 600.0
    """How long the way to a view may take."""
    silence_s: float = 60.0
    """How long to wait for a vehicle that has fallen silent: it flies its mission meanwhile."""
    equipment: bool = True
    """Whether to require a camera, a gimbal and, for ``reserve``, a battery that the vehicle reports."""
    take_over: bool = False
    """Whether to fly a vehicle that somebody else has armed, or flies."""
    send_s: float = 60.0
    """How long photographs may still be sent after the landing."""
    iterations: int | None = None
    """Training iterations of the scene's first update; by default the service's."""
    long_side_px: int | None = None
    """Long side to which the first update reduces photographs; by default the service's."""
    stop_at_db: float | None = None
    """Stop when the expected PSNR of the model reaches this value."""
    mission: MissionSettings = field(default_factory=lambda: MissionSettings())
    """Options of the missions, such as ``transit_height_m`` and ``geofence``."""
    upload_fence: bool = False
    """Whether to replace the vehicle's own fence by the ``geofence`` of ``mission``."""
    terrain: HeightModel | None = None
    """The ground from which heights are measured, instead of home."""


@dataclass(frozen=True)
class FlightResult:
    """The result of a flight: its photographs, those that failed, and why it ended."""

    ending: Ending
    reason: str
    photographs: int
    failed: int
    unsent: int
    """Photographs that the service has not acknowledged yet: they wait in the outbox."""


class EndedError(Exception):
    """The flight is over."""

    def __init__(self, ending: Ending, reason: str) -> None:
        super().__init__(reason)
        self.ending, self.reason = ending, reason
