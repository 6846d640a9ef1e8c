"""Problem documents (RFC 9457) for all errors: the services', the engine's and the framework's."""

from collections.abc import Mapping
from http import HTTPStatus

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import Match

from fvs_engine.errors import EngineError
from fvs_schema.problems import Problem, ProblemField
from fvs_service import errors
from fvs_service.engine_errors import from_engine
from fvs_service.errors import ServiceError
from fvs_service.gateway import validation

MEDIA_TYPE = "application/problem+json"
CLIENT_GONE = 499
"""What logs and metrics show for a request whose client hung up before its end, as in nginx."""
_METHODS = ("DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT")

_BY_STATUS: Mapping[int, type[ServiceError]] = {
    400: errors.MalformedRequestError,
    401: errors.UnauthenticatedError,
    403: errors.ForbiddenError,
    404: errors.NotFoundError,
    405: errors.MethodNotAllowedError,
    413: errors.PayloadTooLargeError,
    415: errors.UnsupportedMediaTypeError,
}

_log = structlog.get_logger()


def install(app: FastAPI) -> None:
    """Make ``app`` respond to every error but a defect with a problem document."""
    app.add_exception_handler(ServiceError, _service_error)
    app.add_exception_handler(EngineError, _engine_error)
    app.add_exception_handler(RequestValidationError, _validation_error)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(ClientDisconnect, _client_gone)


def problem_of(error: ServiceError, request_id: str) -> Problem:
    """The document for ``error``."""
    return Problem(
        type="about:blank",
        title=error.title,
        status=error.status,
        code=error.code,
        detail=error.message,
        hint=error.hint,
        retryable=error.retryable,
        request_id=request_id,
        errors=tuple(ProblemField(field=item.field, message=item.message) for item in error.errors),
    )


def problem_response(
    request: Request, error: ServiceError, headers: Mapping[str, str] | None = None
) -> JSONResponse:
    """The response to a request that failed with ``error``, which the request's state then has."""
    request.state.error = error
    problem = problem_of(error, getattr(request.state, "request_id", ""))
    more = dict(headers or {})
    if error.retry_after_s is not None:
        more["Retry-After"] = str(error.retry_after_s)
    if error.status == HTTPStatus.UNAUTHORIZED:
        more["WWW-Authenticate"] = "Bearer"
    if isinstance(error, errors.RangeError):
        more["Content-Range"] = f"bytes */{error.size_bytes}"
    return JSONResponse(problem.model_dump(mode="json"), error.status, headers=more, media_type=MEDIA_TYPE)


async def _service_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, ServiceError)
    return problem_response(request, error)


async def _engine_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, EngineError)
    return problem_response(request, from_engine(error, request.app.state.application.storage.settings.root))


async def _validation_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    return problem_response(request, validation.invalid_request(error))


async def _http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    if isinstance(error.__cause__, ServiceError):  # raised while the framework read the body
        return problem_response(request, error.__cause__)
    kind = _BY_STATUS.get(error.status_code, errors.MalformedRequestError)
    if error.status_code >= HTTPStatus.INTERNAL_SERVER_ERROR:
        kind = errors.InternalError
    path, headers = request.url.path, error.headers
    problem: ServiceError
    if kind is errors.NotFoundError:
        problem = kind(f"There is nothing at {path}.", hint="GET /openapi.json lists the paths.")
    elif kind is errors.MethodNotAllowedError:
        allowed = ", ".join(_allowed_methods(request))
        problem = kind(f"{request.method} is not allowed at {path}.", hint=f"Allowed methods: {allowed}.")
        headers = {"Allow": allowed}
    elif kind is errors.MalformedRequestError:
        problem = kind("The body cannot be read.", hint="Send JSON in UTF-8 that is not nested too deeply.")
    else:
        problem = kind(str(error.detail))
    return problem_response(request, problem, headers)


async def _client_gone(_request: Request, _error: Exception) -> Response:
    return Response(status_code=CLIENT_GONE)  # for the log and the metrics: nobody receives it


def _allowed_methods(request: Request) -> list[str]:
    """The methods of all routes of the path; the framework names only those of the first route."""
    routes = request.app.routes
    return [
        method
        for method in _METHODS
        if any(route.matches({**request.scope, "method": method})[0] is Match.FULL for route in routes)
    ]


def defect_response(request: Request, error: Exception) -> JSONResponse:
    """The response to a request that failed with ``error``, a defect, which is logged."""
    request_id = getattr(request.state, "request_id", "")
    _log.error("request failed", path=request.url.path, request_id=request_id, exc_info=error)
    return problem_response(request, errors.InternalError("The service failed."))
