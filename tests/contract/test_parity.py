"""The OpenAPI document and ``fvs.v1`` have the same operations, enum values, and fields of the same types."""

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from contract_operations import OPERATIONS
from contract_outcome import rest_word
from contract_types import fits, other_types, type_of_field, type_of_schema
from fvs.v1 import (
    capabilities_pb2,
    control_points_pb2,
    downloads_pb2,
    events_pb2,
    findings_pb2,
    images_pb2,
    jobs_pb2,
    poses_pb2,
    scenes_pb2,
    snapshots_pb2,
    views_pb2,
    webhooks_pb2,
)
from fvs_service.errors import ServiceError
from fvs_service.gateway.rpc.failures import code_of, status_of
from fvs_service.gateway.rpc.operations import has_body
from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Field
from google.protobuf.descriptor_pb2 import FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool

from fvs_schema.events import EventKind

_FILES = (
    *(capabilities_pb2, control_points_pb2, downloads_pb2, events_pb2, findings_pb2, images_pb2, jobs_pb2),
    *(poses_pb2, scenes_pb2, snapshots_pb2, views_pb2, webhooks_pb2),
)

REST_ONLY = {
    "POST /v1/scenes/{scene_id}/images": "a form, for browsers and curl",
    **dict.fromkeys(
        (
            *("OPTIONS /v1/uploads", "POST /v1/uploads", "HEAD /v1/uploads/{upload_id}"),
            *("PATCH /v1/uploads/{upload_id}", "DELETE /v1/uploads/{upload_id}"),
        ),
        "tus, a protocol over HTTP; UploadImage resumes, too",
    ),
    "GET /livez": "a call that is answered shows it",
    "GET /readyz": "grpc.health.v1.Health",
    "GET /metrics": "the format of Prometheus, which asks over HTTP",
}
OTHERWISE = {
    "PUT /v1/scenes/{scene_id}/images/sha256:{hexadecimal}": "UploadImage",
    "GET /v1/scenes/{scene_id}/images/sha256:{hexadecimal}/content": "DownloadImage",
    "GET /v1/scenes/{scene_id}/images/sha256:{hexadecimal}/thumbnail": "GetThumbnail",
    "PUT /v1/scenes/{scene_id}/images/sha256:{hexadecimal}/mask": "SetMask",
    "PUT /v1/scenes/{scene_id}/images/sha256:{hexadecimal}/subtitles": "SetSubtitles",
    "GET /v1/snapshots/{snapshot_id}/artifacts/{name}": "DownloadArtifact",
    "GET /v1/scenes/{scene_id}/events": "WatchEvents",
    "GET /v1/rankings/{ranking_id}/candidates/{candidate_id}/{image}.png": "RenderCandidate",
    "POST /v1/snapshots/{snapshot_id}/renders": "RenderView",
}
"""What is not one request and one response of JSON on both sides."""
RPC_ONLY = {
    "GetUpload": "HEAD /v1/uploads/{upload_id}, of an upload with an id",
    "WatchJob": "a client of REST picks a job's events out of the scene's",
}
MODELS_OF_REST = {
    "Health": "grpc.health.v1",
    "PinholeIntrinsics": "of an artifact",
    "Problem": "google.rpc.Status",
    "ProblemField": "google.rpc.BadRequest",
    "RefusedMask": "of a form",
    "SnapshotCameras": "an artifact",
    "SnapshotView": "of an artifact",
    "UploadAnswer": "of a form",
    "UploadItem": "of a form",
}
PARAMETERS = {
    "hexadecimal": "digest",
    "Idempotency-Key": "idempotency_key",
    "Last-Event-ID": "after",
    "If-Match": "etag",
}
PARAMETERS_OF_HTTP = {
    *("Range", "If-Range", "If-None-Match", "Repr-Digest", "Content-Digest", "X-Timeout-S"),
}
"""Over gRPC: `start` and `stop` of downloads, the digest of an upload's first message, the deadline."""
PLAIN_WORDS = {
    "GridLook": ("Grid", "look"),
    "VolumeLook": ("InVolume", "look"),
    "PoseFrame": ("RankingRequest", "frame"),
}
"""Enums that the document has as values of a field."""

LARGE = {
    *(("Event", "number"), ("WatchEventsRequest", "after")),
    *((kind, at) for kind in ("DownloadArtifactRequest", "DownloadImageRequest") for at in ("start", "stop")),
    *(("DownloadInfo", "start"), ("DownloadInfo", "stop")),
    *(("Webhook", "delivered"), ("NewWebhook", "delivered")),
}
"""Numbers of events, which count over all scenes, and positions in files."""


@pytest.fixture(scope="module")
def document(gateway: Any) -> dict[str, Any]:
    """The document, with one schema for requests and responses: messages have no required fields."""
    text = re.sub(r'(/schemas/\w+)Output"', r'\1"', gateway.client.get("/openapi.json").text)
    document: dict[str, Any] = json.loads(text)
    schemas = document["components"]["schemas"]
    for name in [name for name in schemas if name.endswith("Output")]:
        assert (
            schemas.pop(name)["properties"].keys()
            == schemas[name.removesuffix("Output")]["properties"].keys()
        )
    return document


def _messages() -> dict[str, Any]:
    return {name: found for file in _FILES for name, found in file.DESCRIPTOR.message_types_by_name.items()}


def _enums() -> dict[str, Any]:
    return {name: found for file in _FILES for name, found in file.DESCRIPTOR.enum_types_by_name.items()}


def _methods() -> dict[str, Any]:
    return {
        name: found
        for file in _FILES
        for service in file.DESCRIPTOR.services_by_name.values()
        for name, found in service.methods_by_name.items()
    }


def _operations(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for path, operations in document["paths"].items():
        for verb, operation in operations.items():
            yield f"{verb.upper()} {path}", operation


def _name_of(route: str) -> str:
    """The method of ``fvs.v1`` that is a route."""
    if route in OTHERWISE:
        return OTHERWISE[route]
    verb, path = route.split(" ")
    digest = path.replace("sha256:{hexadecimal}", "{digest}")
    found = [
        name
        for name, one in OPERATIONS.items()
        if (one.verb, one.path) == (verb, digest) and not one.streamed
    ]
    assert len(found) == 1, f"{route} is in neither OPERATIONS nor the exceptions"
    return found[0]


def test_every_operation_exists_on_both_sides(document: dict[str, Any]) -> None:
    routes = {route for route, _ in _operations(document)}
    named = {_name_of(route) for route in routes if route not in REST_ONLY}
    for route, operation in _operations(document):
        if route not in REST_ONLY:
            assert operation["operationId"].replace("_", "") == _name_of(route).lower(), route
    assert set(REST_ONLY) <= routes
    assert set(OTHERWISE) <= routes
    streamed = {name for name, one in OPERATIONS.items() if one.streamed}
    assert named | streamed | set(RPC_ONLY) == set(_methods())


def test_what_has_a_body_over_rest_carries_one_over_grpc(document: dict[str, Any]) -> None:
    """Calls of keys on hold are refused if they carry one."""
    for route, operation in _operations(document):
        if route not in REST_ONLY:
            assert has_body(_methods()[_name_of(route)]) == ("requestBody" in operation), route


def test_every_stream_is_a_media_type_of_its_route(document: dict[str, Any]) -> None:
    """Over REST the same route streams its response, to who accepts server-sent events."""
    for name, one in OPERATIONS.items():
        if not one.streamed:
            continue
        operation = document["paths"][one.path][one.verb.lower()]
        assert "text/event-stream" in operation["responses"]["200"]["content"]
        plain = _methods()[_name_of(f"{one.verb} {one.path}")]
        assert _methods()[name].server_streaming
        assert _shape(_methods()[name].input_type) == _shape(plain.input_type)


def _shape(message: Any) -> list[tuple[str, int, Any]]:
    return [(field.name, field.type, field.message_type) for field in message.fields]


def test_every_parameter_is_a_field_of_the_request(document: dict[str, Any]) -> None:
    for route, operation in _operations(document):
        if route in REST_ONLY:
            continue
        request = _methods()[_name_of(route)].input_type
        if request.name == "UploadImageRequest":
            request = request.fields_by_name["upload"].message_type
        fields = dict(request.fields_by_name)
        if "metadata" in fields:
            fields |= fields["metadata"].message_type.fields_by_name
        for parameter in operation.get("parameters", []):
            name = PARAMETERS.get(parameter["name"], parameter["name"])
            assert name in fields.keys() | PARAMETERS_OF_HTTP, f"{route} {name}"
            if name in fields:
                theirs, ours = type_of_schema(parameter["schema"]), type_of_field(fields[name], PLAIN_WORDS)
                assert fits(theirs, ours), f"{route} {name}: {theirs} is {ours}"
        body = operation.get("requestBody", {}).get("content", {}).get("application/json")
        if body is not None:
            kinds = {field.message_type.name for field in request.fields if field.message_type is not None}
            assert body["schema"]["$ref"].rpartition("/")[2] in kinds


def test_every_model_has_a_message_with_the_same_fields(document: dict[str, Any]) -> None:
    messages = _messages()
    for name, schema in document["components"]["schemas"].items():
        if "properties" not in schema or name in MODELS_OF_REST:
            continue
        fields = {field.name for field in messages[name].fields}
        union = "kind" if "const" in schema["properties"].get("kind", {}) else None
        assert fields == set(schema["properties"]) - {union}, name


def test_every_field_has_the_type_of_its_model(document: dict[str, Any]) -> None:
    assert not list(other_types(document["components"]["schemas"], _messages(), PLAIN_WORDS))


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("Job.progress", {"type": Field.TYPE_FLOAT}),
        ("Job.eta_s", {"type": Field.TYPE_INT64}),
        ("Job.attempt", {"type": Field.TYPE_DOUBLE}),
        ("Job.attempt", {"type": Field.TYPE_UINT32}),
        ("Job.id", {"type": Field.TYPE_BYTES}),
        ("Job.state", {"type_name": ".fvs.v1.JobKind"}),
        ("Job.state", {"type": Field.TYPE_STRING, "type_name": None}),
        ("Job.error", {"type_name": ".fvs.v1.JobWaiting"}),
        ("Job.created_at", {"type": Field.TYPE_STRING, "type_name": None}),
        ("Job.scene_id", {"label": Field.LABEL_REPEATED}),
        ("JobList.items", {"label": Field.LABEL_OPTIONAL}),
    ],
)
def test_another_type_is_found(document: dict[str, Any], name: str, changed: dict[str, Any]) -> None:
    changed_file, pool = FileDescriptorProto(), DescriptorPool()
    jobs_pb2.DESCRIPTOR.CopyToProto(changed_file)
    message_name, _, field_name = name.partition(".")
    message = next(one for one in changed_file.message_type if one.name == message_name)
    field = next(one for one in message.field if one.name == field_name)
    for attribute, value in changed.items():
        field.ClearField(attribute)
        if value is not None:
            setattr(field, attribute, value)
    for imported in jobs_pb2.DESCRIPTOR.dependencies:
        pool.AddSerializedFile(imported.serialized_pb)
    pool.Add(changed_file)
    messages = {message_name: pool.FindMessageTypeByName(f"fvs.v1.{message_name}")}
    assert list(other_types(document["components"]["schemas"], messages, PLAIN_WORDS)) == [name]


def test_only_bytes_and_numbers_of_events_have_64_bits() -> None:
    """JSON of protobuf writes these as strings, and others as numbers."""
    for message in _messages().values():
        for field in message.fields:
            if field.cpp_type in (field.CPPTYPE_INT32, field.CPPTYPE_INT64):
                large = field.name.endswith("_bytes") or (message.name, field.name) in LARGE
                assert (field.cpp_type == field.CPPTYPE_INT64) == large, f"{message.name}.{field.name}"


def test_every_message_has_a_model_or_is_of_grpc(document: dict[str, Any]) -> None:
    schemas = set(document["components"]["schemas"])
    of_calls = {method.input_type.name for method in _methods().values()}
    of_grpc = {
        *("ImageUpload", "UploadImageResponse", "Upload", "ImageMetadata"),  # REST has parameters instead
        *(
            "DownloadInfo",
            "DownloadPart",
            "CandidateRender",
            "ViewRender",
            "Thumbnail",
            "MissionFile",
        ),  # and bodies that are bytes
        *(
            "World",
            "Pose",
            "Generator",
            "Volume",
            "AnyTerrain",
            "Corner",
            "CandidateList",
            "PoseList",
            "Position",
        ),  # and unions and lists without a name
    }
    assert set(_messages()) - schemas - of_calls == of_grpc


def test_every_value_of_an_enum_exists_on_both_sides(document: dict[str, Any]) -> None:
    schemas, enums = document["components"]["schemas"], _enums()
    assert {name for name, schema in schemas.items() if "enum" in schema} | set(PLAIN_WORDS) | {
        "PoseFrame"
    } == set(enums)
    for name, enum in enums.items():
        words = {rest_word(enum, value.number) for value in enum.values if value.number}
        assert words == _values(schemas, name), name


def _values(schemas: dict[str, Any], name: str) -> set[str]:
    if name not in PLAIN_WORDS:
        return set(schemas[name]["enum"])
    model, field = PLAIN_WORDS[name]
    schema = schemas[model]["properties"][field]
    return set(next(part["enum"] for part in (schema, *schema.get("anyOf", ())) if "enum" in part))


def test_the_events_are_those_of_the_service() -> None:
    assert {one.value for one in EventKind} == {
        value.name.removeprefix("EVENT_KIND_").lower().replace("_", ".")
        for value in _enums()["EventKind"].values
        if value.number
    }


def test_fields_that_may_be_null_are_absent_and_those_of_requests_too(document: dict[str, Any]) -> None:
    """A number that a client leaves out must not become 0."""
    for name, schema in document["components"]["schemas"].items():
        if "properties" not in schema or name in MODELS_OF_REST:
            continue
        for field in _messages()[name].fields:
            of_field = schema["properties"][field.name]
            nullable = any(part.get("type") == "null" for part in of_field.get("anyOf", ()))
            if (nullable or name in _sent(document)) and not field.is_repeated and field.enum_type is None:
                assert field.has_presence, f"{name}.{field.name}"


def _sent(document: dict[str, Any]) -> set[str]:
    """The models that requests have."""
    found: set[str] = set()
    for _, operation in _operations(document):
        pending = [operation.get("requestBody", {})]
        while pending:
            part = pending.pop()
            if isinstance(part, dict):
                name = str(part.get("$ref", "")).rpartition("/")[2]
                if name and name not in found:
                    found.add(name)
                    pending.append(document["components"]["schemas"][name])
                pending += part.values()
            elif isinstance(part, list):
                pending += part
    return found


def test_every_error_has_a_status_of_grpc() -> None:
    kinds, pending = set(), [ServiceError]
    while pending:
        kind = pending.pop()
        kinds.add(kind)
        pending += kind.__subclasses__()
    for kind in kinds - {ServiceError}:
        error = kind(5) if kind.code == "range-not-satisfiable" else kind("It failed.")  # type: ignore[arg-type]
        status = status_of(error, "req_1")
        assert code_of(error).value[0] == status.code
        assert (code_of(error).name in ("INTERNAL", "UNAVAILABLE", "DEADLINE_EXCEEDED", "CANCELLED")) == (
            (kind.status >= 499 and kind.status != 507) or kind.status == 408
        ), kind
