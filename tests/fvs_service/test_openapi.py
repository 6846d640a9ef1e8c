import contextlib
from collections import Counter
from typing import Any

import pytest
from fvs_service.scenes.model import Alignment, AlignmentStatus
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.errors import Unsatisfiable


@pytest.fixture(scope="module")
def document(gateway: Any) -> dict[str, Any]:
    return gateway.client.get("/openapi.json").json()


def _operations(document: dict[str, Any]) -> list[tuple[str, str, dict[str, Any]]]:
    return [
        (method, path, operation)
        for path, operations in document["paths"].items()
        for method, operation in operations.items()
    ]


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
    def references(node: Any) -> set[str]:
        if not isinstance(node, dict | list):
            return set()
        own = {node["$ref"]} if isinstance(node, dict) and "$ref" in node else set()
        return own.union(*map(references, node.values() if isinstance(node, dict) else node))

    found = references(document)
    assert "#/components/schemas/Problem" in found
    assert found <= {f"#/components/schemas/{name}" for name in document["components"]["schemas"]}


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
