import contextlib
import re
from collections import Counter
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import Unsatisfiable

from fvs_schema.scenes import Alignment, AlignmentStatus


@pytest.fixture(scope="module")
def document(gateway: Any) -> dict[str, Any]:
    return gateway.client.get("/openapi.json").json()


def _operations(document: dict[str, Any]) -> list[tuple[str, str, dict[str, Any]]]:
    return [
        (method, path, operation)
        for path, operations in document["paths"].items()
        for method, operation in operations.items()
    ]


def _references(node: Any) -> list[dict[str, Any]]:
    """All objects below ``node`` that refer to a schema."""
    if not isinstance(node, dict | list):
        return []
    own = [node] if isinstance(node, dict) and "$ref" in node else []
    inner = node.values() if isinstance(node, dict) else node
    return own + [reference for part in inner for reference in _references(part)]


def test_the_document_is_openapi_31_and_names_every_operation(document: dict[str, Any]) -> None:
    assert document["openapi"].startswith("3.1")
    for method, path, operation in _operations(document):
        assert operation["summary"], (method, path)
        assert operation["description"], (method, path)
        answers = operation["responses"]
        for status in ("4XX", "5XX"):
            assert list(answers[status]["content"]) == ["application/problem+json"]
        assert "422" not in answers
    paths = {path for _, path, _ in _operations(document)}
    for wanted in (
        "/v1/scenes",
        "/v1/scenes/{scene_id}/images:check",
        "/v1/scenes/{scene_id}/images/sha256:{hexadecimal}",
        "/v1/scenes/{scene_id}/events",
        "/v1/jobs/{job_id}:cancel",
        "/v1/jobs/{job_id}:retry",
        "/v1/rankings/{ranking_id}/candidates/{candidate_id}/{image}.png",
        "/v1/snapshots/{snapshot_id}/artifacts/{name}",
        "/v1/capabilities",
        "/livez",
        "/readyz",
        "/metrics",
    ):
        assert wanted in paths


def test_operations_have_names_that_a_person_would_choose(document: dict[str, Any]) -> None:
    """Those of the methods of gRPC, where there is one (``tests/contract`` relates the two)."""
    names = [operation["operationId"] for _, _, operation in _operations(document)]
    assert len({*names}) == len(names)
    assert all(re.fullmatch(r"[a-z]+(_[a-z]+)+", name) for name in names)
    assert {"create_scene", "upload_image", "create_job", "rank_views", "plan_views"} < {*names}
    tags = {tag["name"] for tag in document["tags"] if tag["description"]}
    assert all(len(operation["tags"]) == 1 for _, _, operation in _operations(document))
    assert {tag for _, _, operation in _operations(document) for tag in operation["tags"]} == tags
    assert [server["url"] for server in document["servers"]] == ["/"]


def test_every_part_is_described(document: dict[str, Any]) -> None:
    for method, path, operation in _operations(document):
        for parameter in operation.get("parameters", []):
            assert parameter["description"], (method, path, parameter["name"])
        for status, response in operation["responses"].items():
            assert response["description"], (method, path, status)
    for name, schema in document["components"]["schemas"].items():
        assert schema["description"], name
        for field, part in schema.get("properties", {}).items():
            described = part.get("description", "")
            assert described, f"{name}.{field}"
            assert not described.startswith("Default:"), f"{name}.{field}"


def test_generators_of_clients_can_read_the_schemas(document: dict[str, Any]) -> None:
    """What they cannot read: other keywords than properties at the root, and defaults of fields.

    A header or a parameter of a query cannot be null; binary bodies and streams have a type.
    """
    readable = {"type", "properties", "required", "additionalProperties", "title"}
    readable |= {"description", "examples", "enum"}
    for name, schema in document["components"]["schemas"].items():
        assert schema.keys() <= readable, name
        for field, part in schema.get("properties", {}).items():
            assert not {"default", "title"} & part.keys(), f"{name}.{field}"
    for method, path, operation in _operations(document):
        for parameter in operation.get("parameters", []):
            assert "anyOf" not in parameter["schema"], (method, path, parameter["name"])
        for part in (operation.get("requestBody", {}), *operation["responses"].values()):
            for kind, content in part.get("content", {}).items():
                assert content.get("schema") or kind == "application/json", (method, path, kind)


def test_requests_may_leave_out_what_responses_have(document: dict[str, Any]) -> None:
    schemas = document["components"]["schemas"]
    assert schemas["Policy"].get("required", []) == []
    assert schemas["Policy"]["properties"]["k"]["description"].endswith("Default: `10`.")
    assert schemas["PolicyOutput"]["required"] == [*schemas["PolicyOutput"]["properties"]]
    assert schemas["Scene"]["properties"]["policy"]["$ref"].endswith("/PolicyOutput")
    assert schemas["SceneRequest"]["required"] == ["name"]
    outputs = {
        one["$ref"].rpartition("/")[2]
        for _, _, operation in _operations(document)
        for one in _references(operation["responses"])
    }
    while (
        more := {one["$ref"].rpartition("/")[2] for name in outputs for one in _references(schemas[name])}
        - outputs
    ):
        outputs |= more
    for name in outputs:
        assert schemas[name].get("required", []) == [*schemas[name].get("properties", {})], name


def test_other_methods_are_refused_at_every_path(gateway: Any, document: dict[str, Any]) -> None:
    """405 with ``Allow``, also where a path with an id matches one with a verb, such as ``…:exclude``."""
    for path, operations in document["paths"].items():
        here = re.sub(r"\{hexadecimal\}", "0" * 64, re.sub(r"\{(?!hexadecimal)\w+\}", "x", path))
        allowed = {method.upper() for method in operations}
        for method in {"GET", "POST", "PUT", "PATCH", "DELETE", "TRACE"} - allowed:
            answer = gateway.client.request(method, here)
            assert answer.status_code == 405, (method, here, answer.text)
            assert allowed <= {*answer.headers["Allow"].split(", ")}, (method, here)


def test_fields_are_described_by_their_docstrings(document: dict[str, Any]) -> None:
    fields = document["components"]["schemas"]["SceneList"]["properties"]
    assert fields["next"]["description"] == "The cursor of the next page; null on the last one."


def test_examples_work_when_they_are_pasted(gateway: Any, document: dict[str, Any]) -> None:
    origin = {"latitude_deg": 47.3977, "longitude_deg": 8.5456, "altitude_m": 500.0}
    scene = gateway.scene(world={"kind": "enu", "origin": origin})
    snapshot = gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED))
    ids = {"scene_id": scene, "snapshot_id": snapshot}
    pasted, queries = 0, {"/v1/scenes/{scene_id}/missions": {"format": "csv"}}
    for method, path, operation in _operations(document):
        body = operation.get("requestBody", {}).get("content", {}).get("application/json")
        if body is None:
            continue
        examples = document["components"]["schemas"][body["schema"]["$ref"].rpartition("/")[2]]["examples"]
        for example in examples:
            answer = gateway.client.request(
                method, path.format(**ids), json=example, params=queries.get(path)
            )
            assert answer.status_code in (200, 201, 202), (path, example, answer.text)
            pasted += 1
    assert pasted >= 10


def test_every_reference_in_the_document_leads_somewhere(document: dict[str, Any]) -> None:
    found = {part["$ref"] for part in _references(document)}
    assert "#/components/schemas/Problem" in found
    assert found <= {f"#/components/schemas/{name}" for name in document["components"]["schemas"]}


@pytest.mark.system
@pytest.mark.parametrize("examples", [2, pytest.param(25, marks=pytest.mark.slow)])
@pytest.mark.parametrize("mode", ["positive", "negative"])
def test_whatever_is_sent_is_answered_as_the_document_says(serve: Any, mode: str, examples: int) -> None:
    """Requests made from the document, valid and not; event streams never end, and are left out."""
    # Here, because every worker imports every file of tests, and this takes seconds.
    import schemathesis
    from schemathesis.specs.openapi import checks

    schemathesis.serializer.alias("application/offset+octet-stream", "application/octet-stream")
    schema_checks = (
        checks.status_code_conformance,
        checks.content_type_conformance,
        checks.response_headers_conformance,
        checks.response_schema_conformance,
    )
    url = str(serve().client.base_url)
    schema = schemathesis.openapi.from_url(f"{url}/openapi.json").exclude(path_regex="/events$")
    answered: Counter[int] = Counter()
    for result in schema.get_all_operations():
        operation = result.ok()
        try:
            cases = operation.as_strategy(generation_mode=schemathesis.GenerationMode(mode))
        except Unsatisfiable:  # nothing can be wrong with a request that has no part
            continue

        @settings(
            max_examples=examples,
            deadline=None,
            derandomize=True,
            database=None,
            phases=(Phase.generate,),
            suppress_health_check=list(HealthCheck),
        )
        @given(case=cases)
        def run(case: Any) -> None:
            # 503 is how a gateway without workers says that it is not ready.
            no_error = () if case.path == "/readyz" else (schemathesis.checks.not_a_server_error,)
            answer = case.call_and_validate(checks=(*no_error, *schema_checks))
            answered[answer.status_code] += 1

        with contextlib.suppress(Unsatisfiable):
            run()
    assert sum(answered.values()) >= 25 * examples
    assert set(answered) & {200, 201} if mode == "positive" else set(answered) & {422}
