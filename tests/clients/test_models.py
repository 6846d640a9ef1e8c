"""What models show, offer and refuse, in the client's own words."""

import copy
import pickle
from collections.abc import Callable, Iterator
from typing import Any

import fvs_client
import pydantic
import pytest
from fvs_client import (
    NO_RETRIES,
    Candidate,
    Client,
    ErrorCode,
    FramePose,
    FvsError,
    ImageMetadata,
    Orbit,
    Policy,
    RankingRequest,
    UnexpectedAnswerError,
)
from fvs_client.answers import parse, refusal
from fvs_client.errors import ApiError, NotFoundError, error_of
from fvs_client.models.resources import SceneData
from httpx2 import Response

from fvs_schema.problems import Problem

POSE = FramePose(position=(1, 2, 3), orientation_wxyz=(1, 0, 0, 0))


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: Orbit(cuont=5), "cuont: there is no such field. Did you mean `count`?"),
        (lambda: Orbit(count="many"), "`count` must be a whole number."),
        (lambda: Orbit(count=2.5), "`count` must be a whole number."),
        (lambda: FramePose(position=(1, 2, 3)), "`orientation_wxyz` is missing."),
        (lambda: FramePose(position=(1, 2), orientation_wxyz=(1, 0, 0, 0)), "`position.2` is missing."),
        (lambda: Candidate(id="a", pose=3), "`pose` must be an object."),
        (lambda: Candidate(id="a", pose={"position": (1, 2, 3)}), "`pose.orientation_wxyz` is missing."),
        (lambda: RankingRequest(generator="orbit"), "`generator` must be an object."),
        (
            lambda: RankingRequest(generator={"kind": "orbit", "cuont": 5}),
            "generator.cuont: there is no such field.",
        ),
        (
            lambda: RankingRequest(generator={"kind": "disc"}),
            "`generator`'s kind must be one of 'orbit',",
        ),
        (lambda: RankingRequest(candidates=(POSE,)), "`candidates.0` must be an object."),
        (lambda: RankingRequest(frame="word"), "`frame` must be 'world', 'model' or 'geodetic'."),
        (
            lambda: ImageMetadata(captured_at="noon"),
            "`captured_at` must be a time, as in RFC 3339.",
        ),
        (lambda: Policy(trigger=3), "`trigger` must be 'on-request', 'each-image' or 'every-k-images'."),
        (lambda: RankingRequest(top_k="a", seed="b", budget="c", method=4), "And 1 more."),
    ],
)
def test_wrong_arguments_are_named(make: Callable[[], Any], reason: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 -- the whole text is compared
        make()
    assert reason in str(caught.value)
    assert not isinstance(caught.value, pydantic.ValidationError)
    assert "pydantic" not in str(caught.value)


def test_an_answer_that_does_not_fit_is_described() -> None:
    for content, reason in (
        (b"<html>", "It is no JSON."),
        (b"[]", "It must be an object."),
        (b'{"id": 3}', "`id` must be a string. `name` is missing. `world` is missing. And"),
    ):
        with pytest.raises(UnexpectedAnswerError) as caught:
            parse(SceneData, content)
        assert f"The answer does not fit SceneData: {reason}" in str(caught.value)
        assert caught.value.hint
        assert caught.value.code is ErrorCode.UNEXPECTED_ANSWER


def test_models_cannot_be_changed_but_copied() -> None:
    with pytest.raises(ValueError, match="frozen"):
        POSE.position = (0, 0, 0)  # type: ignore[misc]
    with pytest.raises(ValueError, match="frozen"):
        POSE.elsewhere = 1  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="frozen"):
        del POSE.position
    assert copy.deepcopy(POSE) == pickle.loads(pickle.dumps(POSE)) == POSE


def test_a_scene_shows_itself_and_offers_what_it_can_do(client: Client) -> None:
    scene = client.scenes.create("quarry")
    assert repr(scene) == str(scene) == f"Scene(id={scene.id!r}, name='quarry', images=0, snapshot_id=None)"
    offered = [name for name in dir(scene) if not name.startswith("_")]
    assert {"rank", "plan", "name", "images", "image_counts"} < set(offered)
    assert not [name for name in offered if name.startswith("model_") or hasattr(pydantic.BaseModel, name)]
    assert repr(client) == f"Client({client.url!r})"


def _below(kind: type[Any]) -> Iterator[type[Any]]:
    for child in kind.__subclasses__():
        yield from (child, *_below(child))


def test_every_error_has_a_code_that_completes() -> None:
    known = set(ErrorCode)
    ours = [kind for kind in _below(FvsError) if kind.__module__.startswith("fvs_client")]
    assert {kind.code for kind in ours} <= known
    assert NotFoundError.code == "not-found"


def test_the_code_of_an_error_is_the_service_s() -> None:
    error = error_of(Problem(status=409, code="offset-mismatch"))
    assert (type(error).__name__, error.code) == ("ConflictError", ErrorCode.OFFSET_MISMATCH)
    assert error_of(Problem(status=404, code="of-a-newer-one")).code == "of-a-newer-one"
    assert refusal(Response(404, content=b"<html>"), "req").code is ErrorCode.NOT_FOUND
    assert refusal(Response(418, content=b"tea"), "req").code is ErrorCode.UNEXPECTED_ANSWER
    assert ApiError in _below(FvsError)


def test_nobody_answers_with_a_code() -> None:
    with (
        Client("http://127.0.0.1:9", retries=NO_RETRIES) as client,
        pytest.raises(FvsError) as caught,
    ):
        client.health()
    assert caught.value.code is ErrorCode.CONNECTION_FAILED
    assert "ErrorCode" in fvs_client.__all__
