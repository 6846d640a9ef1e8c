"""``fvs-client fly``: what it refuses, and what it prints."""

import json
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fvs_client import AltitudeDatum, Client, EnuWorld, Origin
from fvs_client.cli.app import app
from fvs_client.cli.exit_codes import NOT_FLOWN
from fvs_client.spool.lock import only_sender
from fvs_client.spool.outbox import FILE_NAME
from typer.testing import CliRunner, Result

from fvs_engine.lab.simulate.mavlink.flight_state import Faults

pytestmark = pytest.mark.process

Run = Callable[..., Result]
SURVEY = ("--survey", "47.3769,8.5417,24,15", "--survey-views", "3", "--survey-arc", "60")


@pytest.fixture
def run(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    monkeypatch.setenv("FVS_URL", url)
    monkeypatch.delenv("FVS_API_KEY", raising=False)
    monkeypatch.setenv("COLUMNS", "200")
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def run(*words: str, vehicle: str = "tcp:127.0.0.1:1", photographs: Path = tmp_path) -> Result:
        given = ("--yes", "--vehicle", vehicle, "--photographs", str(photographs), *words)
        return CliRunner().invoke(app, ["fly", *given])

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture
def scene_id(client: Client) -> str:
    home = Origin(
        latitude_deg=47.3769, longitude_deg=8.5417, altitude_m=440.0, altitude_datum=AltitudeDatum.SEA_LEVEL
    )
    return client.scenes.create("command", world=EnuWorld(origin=home)).id


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--safety", "3"), "give --leg"),
        (("--leg", "2", "--generator", "around-current"), "give another --generator"),
        (("--leg", "0"), "--leg"),
        (("--system", "255"), "--system"),
        (("--geofence", "47.3,8.5;47.4,8.5;north"), "'north' is not a latitude,longitude"),
        (("--terrain", __file__), "is no height model"),
        (("--upload-fence",), "give --geofence"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    run: Run, scene_id: str, words: tuple[str, ...], reason: str
) -> None:
    result = run(scene_id, *words)
    assert result.exit_code == 2
    assert reason in result.output


def test_a_vehicle_that_is_not_there_is_named(
    run: Run, scene_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.sleep", lambda _s: None)  # pymavlink tries six times
    result = run(scene_id)
    assert result.exit_code not in (0, 2)
    assert "tcp:127.0.0.1:1 cannot be opened" in result.stderr
    assert result.stdout == ""


def test_a_vehicle_without_a_gimbal_is_not_flown(run: Run, scene_id: str, simulated: Any) -> None:
    with simulated(faults=Faults(no_gimbal=True)) as simulator:
        result = run(scene_id, *SURVEY, vehicle=simulator.url, photographs=simulator.folder)
    assert result.exit_code == NOT_FLOWN
    assert "reports no gimbal" in result.stdout
    assert "0 photographs, 0 failed" in result.stdout


@pytest.mark.system
def test_a_folder_with_another_spool_is_not_flown_with(run: Run, scene_id: str, simulated: Any) -> None:
    with simulated() as simulator, only_sender(simulator.folder / FILE_NAME):
        result = run(scene_id, *SURVEY, vehicle=simulator.url, photographs=simulator.folder)
    assert result.exit_code not in (0, 2)
    assert "Another process sends from" in result.stderr
    assert "fvs-client spool watch" in result.stderr


@pytest.mark.system
def test_the_result_is_one_document(run: Run, gateway: Any, scene_id: str, simulated: Any) -> None:
    done = threading.Event()

    def work() -> None:
        while not done.wait(0.05):
            if scene_id in gateway.queued_jobs().values():
                gateway.model(scene_id)

    worker = threading.Thread(target=work)
    worker.start()
    try:
        with simulated(firmware="px4") as simulator:
            result = run(
                scene_id,
                *SURVEY,
                *("--views", "3", "--system", "1", "--json"),
                vehicle=simulator.url,
                photographs=simulator.folder,
            )
    finally:
        done.set()
        worker.join()
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert (document["ending"], document["photographs"], document["failed"]) == ("budget", 3, 0)
