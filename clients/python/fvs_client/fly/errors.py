"""Failures of a vehicle."""

from fvs_client.errors import FvsError
from fvs_schema.error_codes import ErrorCode


class VehicleError(FvsError):
    """The vehicle does not answer, refuses something, or its camera takes no photograph."""

    code = ErrorCode.VEHICLE


class NoAnswerError(VehicleError):
    """The vehicle has been silent for too long: it may still fly its last mission."""
