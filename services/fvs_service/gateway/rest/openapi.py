"""The OpenAPI document: FastAPI's, with problem documents as the responses to errors."""

from collections.abc import Iterable
from typing import Any

from fastapi import FastAPI
from pydantic.json_schema import models_json_schema

from fvs_service.gateway.rest.problems import MEDIA_TYPE, Problem
from fvs_service.model import Model

_DESCRIPTION = """
Send images, get a 3D model that grows with them, and rank the poses that could be photographed next.

1. `POST /v1/scenes` creates a scene.
2. `PUT …/images/sha256:…` sends images.
3. `POST …/jobs` with `{"kind": "update"}` updates the model; `GET …/events` streams its progress.
4. `POST …/rankings` ranks poses; `POST …/plans` plans a flight through some of them.

Every error is a problem document (RFC 9457) with a stable `code`, a `hint`, and a `request_id`. Poses are
`frame_from_camera` of an OpenCV camera (x right, y down, z forward); quaternions are unit, `w` first.
"""

_REFERENCE = "#/components/schemas/{model}"
PROBLEM_RESPONSE: dict[str, Any] = {
    "description": "A problem document.",
    "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
}


def describe(app: FastAPI, bodies: Iterable[type[Model]], *, keys_required: bool) -> None:
    """Make the OpenAPI document of ``app`` describe its errors, and whether keys are required.

    ``bodies`` are the models of JSON bodies, which FastAPI does not know (``bodies.json_body``).
    """
    _, definitions = models_json_schema([(kind, "validation") for kind in bodies], ref_template=_REFERENCE)
    original = app.openapi
    app.description = _DESCRIPTION

    def openapi() -> dict[str, Any]:
        if app.openapi_schema:
            return app.openapi_schema
        document = original()
        schemas = document.setdefault("components", {}).setdefault("schemas", {})
        schemas.update(definitions.get("$defs", {}))
        problem = Problem.model_json_schema(ref_template=_REFERENCE, mode="serialization")
        schemas.update(problem.pop("$defs", {}))
        schemas["Problem"] = problem
        for unused in ("HTTPValidationError", "ValidationError"):
            schemas.pop(unused, None)
        for path in document["paths"].values():
            for operation in path.values():
                operation["responses"].pop("422", None)
                operation["responses"]["4XX"] = PROBLEM_RESPONSE
                operation["responses"]["5XX"] = PROBLEM_RESPONSE
                if "security" in operation and not keys_required:
                    operation["security"] = [{}, *operation["security"]]
        return document

    app.openapi = openapi  # type: ignore[method-assign]
