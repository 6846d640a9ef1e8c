import socket
import threading

import numpy as np
import pytest
from fvs_service.errors import InvalidRequestError, UnavailableError
from fvs_service.rankings.port import RankViews, RunnerView
from fvs_service.worker.protocol import (
    QUESTION,
    Line,
    PingQuestion,
    RankQuestion,
    RunnerError,
    RunnerGoneError,
    answer_to,
    connect,
    error_of,
    note_of,
)
from fvs_service.worker.runners import METHODS

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.select.selectors import SELECTORS


def test_a_ranking_question_survives_the_wire() -> None:
    camera = PinholeCamera(32, 24, 30.1, 30.2, 16.0, 12.0)
    view = RunnerView("a", camera, look_at([1, 2, 3], [0, 0, 0], [0, 0, 1]), 0.1)
    asked = RankQuestion.of(RankViews("scene", "snapshot", "fisher", (view,), pinned=True, budget=2, seed=3))
    heard = QUESTION.validate_json(asked.model_dump_json())
    assert heard == asked
    again = heard.views[0].view()
    assert again.camera == camera
    assert again.distance_m == 0.1
    np.testing.assert_array_equal(again.camera_from_model.matrix, view.camera_from_model.matrix)


def test_the_gateway_knows_all_methods_of_the_engine() -> None:
    assert set(METHODS) == set(SELECTORS)


def test_errors_keep_their_kind_on_the_wire() -> None:
    error = error_of(note_of(InvalidInputError("Wrong.", hint="Mend it.")))
    assert isinstance(error, InvalidRequestError)
    assert (error.message, error.hint) == ("Wrong.", "Mend it.")
    assert isinstance(error_of(note_of(UnavailableError("Later."))), UnavailableError)
    assert error_of(note_of(ZeroDivisionError("oops"))).code == "internal"


@pytest.fixture
def listening() -> socket.socket:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def _answer(server: socket.socket, *documents: object) -> threading.Thread:
    def serve() -> None:
        line = Line(server.accept()[0])
        line.receive()
        line.receive()
        for document in documents:
            line.send(document)
        line.close()

    thread = threading.Thread(target=serve)
    thread.start()
    return thread


def _ask(server: socket.socket) -> object:
    line = connect(f"127.0.0.1:{server.getsockname()[1]}/secret", 5)
    try:
        return answer_to(line, PingQuestion())
    finally:
        line.close()


def test_notes_come_before_the_answer(listening: socket.socket) -> None:
    thread = _answer(listening, {"warning": "mind"}, {"result": 7})
    assert _ask(listening) == 7
    thread.join()


def test_a_failure_is_raised(listening: socket.socket) -> None:
    note = {"code": "training-failed", "message": "Diverged.", "hint": "", "retryable": True}
    thread = _answer(listening, {"error": note})
    with pytest.raises(RunnerError) as caught:
        _ask(listening)
    assert caught.value.note.code == "training-failed"
    thread.join()


def test_a_runner_that_dies_while_it_answers_is_gone(listening: socket.socket) -> None:
    thread = _answer(listening, {"warning": "dying"})
    with pytest.raises(RunnerGoneError):
        _ask(listening)
    thread.join()


def test_nobody_there_is_gone_too(listening: socket.socket) -> None:
    port = listening.getsockname()[1]
    listening.close()
    with pytest.raises(RunnerGoneError):
        connect(f"127.0.0.1:{port}/secret", 1)
