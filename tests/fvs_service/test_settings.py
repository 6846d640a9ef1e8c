"""Every number of the settings has a range: refused by name outside of it, harmless at its ends."""

from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from fvs_service.settings import Settings
from fvs_service.worker.sweep import Sweeps
from pydantic import ValidationError

_SCHEMA = Settings.model_json_schema()
_PROCESSES = ("inspectors",)
"""Each of them would be started."""


def _numbers(
    schema: Mapping[str, Any] = _SCHEMA, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """The path of every number in the settings, and its schema."""
    if "$ref" in schema:
        schema = _SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]]
    for one in schema.get("anyOf", (schema,)):
        if one.get("type") in ("integer", "number"):
            yield path, one
    for name, inner in schema.get("properties", {}).items():
        yield from _numbers(inner, (*path, name))


NUMBERS = dict(_numbers())


def _variable(path: tuple[str, ...]) -> str:
    return "FVS_" + "__".join(path).upper()


def test_every_number_has_a_range() -> None:
    assert len(NUMBERS) > 50
    without = [path for path, schema in NUMBERS.items() if not {"minimum", "maximum"} <= schema.keys()]
    assert without == []


@pytest.mark.parametrize("path", NUMBERS, ids=_variable)
def test_numbers_outside_of_their_range_are_refused_by_name(
    path: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    lowest, highest = NUMBERS[path]["minimum"], NUMBERS[path]["maximum"]
    for text in ("nan", "inf", "-inf", "1e308", "9" * 5000, "many", str(lowest - 1), str(highest * 2 + 1)):
        monkeypatch.setenv(_variable(path), text)
        with pytest.raises(ValidationError) as error:
            Settings()
        assert {one["loc"] for one in error.value.errors()} == {path}, text


def _all_at(end: str) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    for path, schema in NUMBERS.items():
        inner = settings
        for name in path[:-1]:
            inner = inner.setdefault(name, {})
        if path[-1] not in _PROCESSES:
            inner[path[-1]] = schema[end]
    return settings


@pytest.mark.parametrize("end", ["minimum", "maximum"])
def test_the_service_starts_and_sweeps_at_the_ends_of_all_ranges(open_gateway: Any, end: str) -> None:
    settings = {**_all_at(end), "reserve_bytes": 0}
    gateway = open_gateway(**settings)
    limits = gateway.client.get("/v1/capabilities").json()["limits"]
    assert limits == settings["limits"]
    if end == "maximum":
        scene = gateway.scene()
        gateway.model(scene)
        job_id = gateway.queue(scene)
        assert gateway.client.get(f"/v1/jobs/{job_id}").json()["state"] == "queued"
    Sweeps(gateway.application.storage).sweep()
