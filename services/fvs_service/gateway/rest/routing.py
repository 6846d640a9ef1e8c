"""Routes that keep JSON away from the event loop.

Their bodies are read by dependencies (``bodies.json_body``), their results serialised in the thread of the
handler.
"""

import functools
import inspect
from collections.abc import Callable, Iterator
from typing import Any, get_origin

from fastapi import APIRouter, Response
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool
from starlette.convertors import StringConvertor, register_url_convertor

from fvs_schema.base import Model


class _Plain(StringConvertor):
    """A path parameter without a colon, so that ``job_…:cancel`` is not a job's id."""

    regex = "[^/:]+"


register_url_convertor("plain", _Plain())


class JsonRoute(APIRoute):
    """Serialises the models that its endpoint returns; FastAPI would do it on the event loop."""

    def __init__(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        super().__init__(path, _serialising(endpoint, options.get("status_code") or 200), **options)
        kinds = (getattr(dependency.call, "kind", None) for dependency in self.dependant.dependencies)
        self.body: type[Model] | None = next((kind for kind in kinds if kind is not None), None)
        self.parameters = dict(_parameters(self.dependant))
        """The names of the parameters of its query, and whether each may come several times."""
        if self.body is not None:
            schema = {"$ref": f"#/components/schemas/{self.body.__name__}"}
            content = {"application/json": {"schema": schema}}
            self.openapi_extra = {"requestBody": {"required": True, "content": content}}


class HeadRouter(APIRouter):
    """A router that answers HEAD wherever it answers GET: the server sends the response without its body."""

    def add_api_route(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        """Add a route, and with one for GET that for HEAD, which the OpenAPI document leaves out."""
        super().add_api_route(path, endpoint, **options)
        if options.get("methods") == ["GET"]:
            head = {**options, "methods": ["HEAD"], "include_in_schema": False}
            super().add_api_route(path, endpoint, **head)


def json_router(prefix: str, tag: str) -> APIRouter:
    """A router of ``JsonRoute``."""
    return HeadRouter(prefix=prefix, tags=[tag], route_class=JsonRoute)


def _parameters(dependant: Dependant) -> Iterator[tuple[str, bool]]:
    for field in dependant.query_params:
        kind = field.field_info.annotation
        if isinstance(kind, type) and issubclass(kind, Model):
            for name, inner_field in kind.model_fields.items():
                yield name, get_origin(inner_field.annotation) is tuple
        else:
            yield field.alias, False
    for inner in dependant.dependencies:
        yield from _parameters(inner)


def _serialising(endpoint: Callable[..., Any], status: int) -> Callable[..., Any]:
    """The endpoint with a ``Response`` in place of the model that it returns."""

    def serialised(result: Any, given: Any) -> Any:
        if not isinstance(result, Model):
            return result
        made = Response(result.model_dump_json(), status, media_type="application/json")
        if isinstance(given, Response):  # the endpoint's parameter for headers and another status
            made.status_code = given.status_code or status
            made.raw_headers.extend(given.headers.raw)
        return made

    if inspect.iscoroutinefunction(endpoint):

        @functools.wraps(endpoint)
        async def call_async(**arguments: Any) -> Any:
            result = await endpoint(**arguments)
            if not isinstance(result, Model):
                return result
            return await run_in_threadpool(serialised, result, arguments.get("response"))

        return call_async

    @functools.wraps(endpoint)
    def call(**arguments: Any) -> Any:
        return serialised(endpoint(**arguments), arguments.get("response"))

    return call
