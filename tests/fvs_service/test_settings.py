"""Settings that cannot be used are refused by name; those at the ends of their ranges are harmless."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import typer
from fvs_service.cli.options import settings_of
from fvs_service.environment import OF_OTHERS, variables_of
from fvs_service.host.worker.sweep import Sweeps
from fvs_service.settings import Settings
from pydantic import ValidationError

REPOSITORY = Path(__file__).resolve().parents[2]
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


@pytest.mark.parametrize(
    ("variable", "nearest"),
    [
        ("FVS_RESERVE_BYTE", "FVS_RESERVE_BYTES"),
        ("FVS_REQUIRE_KEY", "FVS_REQUIRE_KEYS"),
        ("FVS_WORKER_COUNT", "FVS_WORKER__COUNT"),
        ("FVS_WORKER__COUNTS", "FVS_WORKER__COUNT"),
        ("FVS_ROOT__IMAGE_BYTES", "FVS_LIMITS__IMAGE_BYTES"),
    ],
)
def test_a_misspelt_variable_is_refused_with_the_nearest_name(
    variable: str, nearest: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(variable, "1")
    with pytest.raises(typer.Exit):
        settings_of()
    assert capsys.readouterr().err == (
        f"Error: {variable}: There is no such setting. Did you mean {nearest}?\n"
    )


@pytest.mark.parametrize("nested", [True, False])
def test_a_file_has_the_value_of_a_variable(
    nested: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "secret").write_text("postgresql://secret\n")
    monkeypatch.setenv("FVS_BLOBS__URL", "s3://bucket")
    name = "FVS_BLOBS__SECRET_ACCESS_KEY" if nested else "FVS_DATABASE_URL"
    monkeypatch.setenv(f"{name}_FILE", str(tmp_path / "secret"))
    settings = Settings()
    assert (settings.blobs.secret_access_key if nested else settings.database_url) == "postgresql://secret"
    assert settings.blobs.url == "s3://bucket"


def test_a_misspelt_variable_for_a_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "secret").write_text("secret")
    monkeypatch.setenv("FVS_DATABASE_ULR_FILE", str(tmp_path / "secret"))
    with pytest.raises(ValidationError) as error:
        Settings()
    assert {one["loc"] for one in error.value.errors()} == {("database_ulr",)}
    assert "secret" not in str(error.value)


def test_variables_of_other_programs_of_the_project_are_let_be(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in OF_OTHERS:
        monkeypatch.setenv(variable, "x")
    assert Settings() == Settings(root="fvs-service")


def test_every_variable_that_the_project_names_is_known() -> None:
    """Else a program of its own that starts the service with its environment would be refused."""
    known = {*variables_of(Settings), *OF_OTHERS}
    for folder in ("clients", "tests", "benchmarks", "demo", "deploy"):
        for file in (REPOSITORY / folder).rglob("*.py"):
            if file != Path(__file__):
                read = re.findall(r"""["'](FVS_[A-Z_]*[A-Z])["']""", file.read_text(encoding="utf-8"))
                assert {name.removesuffix("_FILE") for name in read} <= known, file
