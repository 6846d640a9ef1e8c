"""Parameters of the query: a route refuses those that it does not have, and one value given twice."""

from fastapi import Request

from fvs_schema.error_codes import FieldError
from fvs_service.errors import InvalidRequestError
from fvs_service.gateway.rest.routing import JsonRoute

_SHOWN = 100
"""Maximum length of a name in an error."""


def require_known_query(request: Request) -> None:
    """Raise ``InvalidRequestError`` for a parameter that the route does not have, or that comes twice."""
    if not request.url.query:
        return
    route = request.scope.get("route")
    known = route.parameters if isinstance(route, JsonRoute) else {}
    names = [name for name, _ in request.query_params.multi_items()]
    for name in names:
        shown = name[:_SHOWN]
        if name not in known:
            have = ", ".join(sorted(known))
            raise InvalidRequestError(
                f"There is no parameter {shown!r}.",
                hint=f"The parameters are {have}." if have else "Leave it out: there are none here.",
                errors=[FieldError(shown, "there is no such parameter")],
            )
        if names.count(name) > 1 and not known[name]:
            raise InvalidRequestError(
                f"The parameter {shown!r} is given twice.",
                hint="Give it once.",
                errors=[FieldError(shown, "it is given twice")],
            )
