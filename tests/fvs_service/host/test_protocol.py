import json
import socket
import threading
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from fvs_service.errors import InvalidRequestError, UnavailableError
from fvs_service.host.protocol.connection import (
    Connection,
    RunnerError,
    RunnerGoneError,
    call,
    connect,
)
from fvs_service.host.protocol.messages import REQUEST, Ping, Warned, error_of, failure_of
from fvs_service.rankings.port import RankedViews, RankViews
from pydantic import ValidationError
from pydantic_core import PydanticSerializationError

from fvs_engine.candidates import RankedCandidate
from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.lab.baselines import SELECTORS
from fvs_engine.views import PinholeView
from fvs_schema.candidates import CandidateStatus
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.words import Method


def test_a_ranking_survives_the_wire_bit_by_bit() -> None:
    camera = PinholeCamera(32, 24, 30.1, 30.2, 16.0, 12.0)
    view = PinholeView("a", camera, look_at([1, 2, 3], [0, 0, 0], [0, 0, 1]))
    request = RankViews(
        scene_id="scene",
        snapshot_id="snapshot",
        method="fisher",
        views=(view,),
        distances={"a": 0.1},
        budget=2,
        seed=3,
    )
    received = REQUEST.validate_json(request.model_dump_json())
    assert isinstance(received, RankViews)
    assert received.model_dump(exclude={"views"}) == request.model_dump(exclude={"views"})
    (again,) = received.views
    assert (again.name, again.camera) == ("a", camera)
    np.testing.assert_array_equal(again.camera_from_model.matrix, view.camera_from_model.matrix)

    candidate = RankedCandidate(1, "a", 0.1 + 0.2, CandidateStatus.RANKED, 0.7, 0.1)
    ranked = RankedViews(snapshot_id="snapshot", iterations=7, gaussians=60, candidates=(candidate,))
    assert RankedViews.model_validate_json(ranked.model_dump_json()) == ranked


def _question(*views: PinholeView) -> RankViews:
    return RankViews(scene_id="scene", snapshot_id="snapshot", method="fisher", views=views)


def test_views_on_the_wire_have_one_camera_and_a_pose_each() -> None:
    assert REQUEST.validate_json(_question().model_dump_json()) == _question()
    pose = look_at([1, 2, 3], [0, 0, 0], [0, 0, 1])
    one, other = (
        PinholeView(name, PinholeCamera(32, 24, 30, 30, cx, 12), pose) for name, cx in (("a", 16), ("b", 15))
    )
    with pytest.raises(PydanticSerializationError, match="must have one camera"):
        _question(one, other).model_dump_json()
    document = _question(one).model_dump_json()
    for found, put in (
        ('"names":["a"]', '"names":["a","b"]'),
        ('"camera_from_model":[', '"camera_from_model":[9,'),
    ):
        assert found in document
        with pytest.raises(ValidationError, match="a pose is 12 numbers"):
            REQUEST.validate_json(document.replace(found, put, 1))
    with pytest.raises(ValidationError, match="the views have no camera"):
        REQUEST.validate_json(
            json.dumps({**json.loads(document), "views": {**json.loads(document)["views"], "camera": None}})
        )


def test_the_gateway_knows_all_methods_of_the_engine() -> None:
    assert {*get_args(Method)} == set(SELECTORS)


def test_errors_keep_their_kind_on_the_wire() -> None:
    error = error_of(failure_of(InvalidInputError("Wrong.", hint="Correct it."), Path("/srv")))
    assert isinstance(error, InvalidRequestError)
    assert (error.message, error.hint) == ("Wrong.", "Correct it.")
    assert isinstance(error_of(failure_of(UnavailableError("Later."), Path("/srv"))), UnavailableError)
    defect = error_of(failure_of(ZeroDivisionError("oops"), Path("/srv")))
    assert (defect.code, defect.message) == ("internal", "The service failed.")
    assert "log of its runner" in defect.hint


@pytest.fixture
def listening() -> socket.socket:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def _respond(server: socket.socket, *documents: object) -> threading.Thread:
    def serve() -> None:
        connection = Connection(server.accept()[0])
        connection.receive()
        connection.receive()
        for document in documents:
            connection.send(document)
        connection.close()

    thread = threading.Thread(target=serve)
    thread.start()
    return thread


def _call(server: socket.socket) -> object:
    return call(f"127.0.0.1:{server.getsockname()[1]}/secret", Ping(), 5)


ODD = Finding.of(FindingCode.UNCALIBRATED)


def test_warnings_precede_the_result(listening: socket.socket) -> None:
    thread = _respond(listening, {"part": Warned(finding=ODD)}, {"result": 7})
    assert _call(listening) == 7
    thread.join()


def test_a_failure_is_raised(listening: socket.socket) -> None:
    failure = {"code": "training-failed", "message": "Diverged.", "hint": "", "retryable": True}
    thread = _respond(listening, {"error": failure})
    with pytest.raises(RunnerError) as caught:
        _call(listening)
    assert caught.value.failure.code == "training-failed"
    thread.join()


def test_a_runner_that_dies_before_its_response_is_gone(listening: socket.socket) -> None:
    thread = _respond(listening, {"part": Warned(finding=ODD)})
    with pytest.raises(RunnerGoneError):
        _call(listening)
    thread.join()


def test_without_a_runner_it_is_gone(listening: socket.socket) -> None:
    port = listening.getsockname()[1]
    listening.close()
    with pytest.raises(RunnerGoneError):
        connect(f"127.0.0.1:{port}/secret", 1)
