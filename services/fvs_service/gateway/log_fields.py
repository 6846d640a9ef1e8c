"""Fields of requests' log lines, besides method, path and status."""

from collections.abc import Mapping
from http import HTTPStatus

from fvs_service.errors import ServiceError
from fvs_service.logs import reason_of

_ID = "_id"


def about(named: Mapping[str, object]) -> dict[str, str]:
    """The resources of a request: its ids, named without the ending ``_id`` (``scene``, ``job``)."""
    return {
        name.removesuffix(_ID): value
        for name, value in named.items()
        if name.endswith(_ID) and isinstance(value, str) and value
    }


def cause(status: int, error: ServiceError | None) -> dict[str, str]:
    """Why the service failed, if it did."""
    if error is None or status < HTTPStatus.INTERNAL_SERVER_ERROR:
        return {}
    return {"code": error.code, "error": error.message, "reason": reason_of(error)}
