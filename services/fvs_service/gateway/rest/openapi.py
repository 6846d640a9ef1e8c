"""The OpenAPI document: FastAPI's, with the bodies that it does not know and problem documents as errors."""

from collections.abc import Iterable
from typing import Any

from fastapi import FastAPI
from pydantic.json_schema import models_json_schema

from fvs_schema.base import Model
from fvs_schema.events import Event
from fvs_schema.problems import Problem
from fvs_schema.rankings import RankingPart
from fvs_schema.snapshots import SnapshotCameras
from fvs_service.gateway.rest.openapi_schemas import REFERENCE, merged, rename, tidy, without_null
from fvs_service.gateway.rest.problems import MEDIA_TYPE

_DESCRIPTION = """
Send images, get a 3D model that grows with them, and rank the poses that could be photographed next.

1. `POST /v1/scenes` creates a scene.
2. `PUT …/images/sha256:…` sends images.
3. `POST …/jobs` with `{"kind": "update"}` updates the model; `GET …/events` streams its progress.
4. `POST …/rankings` ranks poses; `POST …/plans` plans a flight through some of them.

Every error is a problem document (RFC 9457) with a stable `code`, a `hint`, and a `request_id`. Poses are
`frame_from_camera` of an OpenCV camera (x right, y down, z forward); quaternions are unit, `w` first.
"""

TAGS = {
    "scenes": "What is photographed: its settings, images, models and rankings.",
    "images": "Photographs of a scene, and their verdicts.",
    "uploads": "Images in any number of requests, over links that break: tus 1.0.0.",
    "jobs": "Updates and fine models.",
    "events": "What happens in a scene, as server-sent events.",
    "webhooks": "Where events of a scene are sent, signed and with retries.",
    "rankings": "Candidates in the order in which to photograph them, and renders of their views.",
    "forecasts": "What a model does not know, at poses and over its surface.",
    "plans": "Which candidates to photograph in which order, by one vehicle or several.",
    "visits": "What vehicles do about views.",
    "missions": "Views as files for autopilots and ground stations.",
    "snapshots": "Models, and their files.",
    "service": "The service itself: features, health and metrics.",
}
_IN_BYTES = (Event, RankingPart, SnapshotCameras)
"""What streams and artifacts consist of: the document has their schemas, which no operation refers to."""
PROBLEM_RESPONSE: dict[str, Any] = {
    "description": "A problem document.",
    "content": {MEDIA_TYPE: {"schema": {"$ref": REFERENCE.format(model=Problem.__name__)}}},
}


def describe(app: FastAPI, bodies: Iterable[type[Model]], *, keys_required: bool) -> None:
    """Make the OpenAPI document of ``app`` describe its errors, and whether keys are required.

    ``bodies`` are the models of JSON bodies, which FastAPI does not know (``bodies.json_body``).
    """
    original = app.openapi
    app.description = _DESCRIPTION
    app.openapi_tags = [{"name": name, "description": about} for name, about in TAGS.items()]
    app.servers = [{"url": "/", "description": "The service that this document comes from."}]

    def openapi() -> dict[str, Any]:
        if app.openapi_schema:
            return app.openapi_schema
        document = original()
        _, sent = models_json_schema([(kind, "validation") for kind in bodies], ref_template=REFERENCE)
        answered = (Problem, *_IN_BYTES)
        _, more = models_json_schema([(kind, "serialization") for kind in answered], ref_template=REFERENCE)
        components = document.setdefault("components", {})
        outputs = {**components.get("schemas", {}), **more["$defs"]}
        for unused in ("HTTPValidationError", "ValidationError"):
            outputs.pop(unused, None)
        schemas, renamed = merged(sent.get("$defs", {}), outputs)
        for name, schema in schemas.items():
            tidy(name, schema)
        components["schemas"] = dict(sorted(schemas.items()))
        for path in document["paths"].values():
            for operation in path.values():
                _finish(operation, renamed, keys_required=keys_required)
        return document

    app.openapi = openapi  # type: ignore[method-assign]


def _finish(operation: dict[str, Any], renamed: dict[str, str], *, keys_required: bool) -> None:
    for parameter in operation.get("parameters", ()):
        parameter["schema"] = without_null(parameter["schema"])
    responses = operation["responses"]
    responses.pop("422", None)
    rename(responses, renamed)
    responses["4XX"] = responses["5XX"] = PROBLEM_RESPONSE
    if "security" in operation and not keys_required:
        operation["security"] = [{}, *operation["security"]]
