"""Requests and answers of the native jobs on their way through JSON."""

import json
from pathlib import Path

import pytest
from pydantic import ValidationError

from fvs_engine.sfm.jobs import (
    REQUESTS,
    CalibrateViewGraph,
    MapGlobally,
    PairVeto,
    VetoPairs,
)
from fvs_engine.sfm.native.jobs import find_job
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors


@pytest.mark.parametrize("job", list(REQUESTS))
def test_every_request_has_a_job_of_its_name(job: str):
    assert find_job(job).__name__ == job


def test_a_request_is_the_same_after_its_way_to_the_child():
    priors = PosePriors(by_name={"1.jpg": PosePrior(position=(0.1, 1 / 3, -1e-300), position_sigma=0.7)})
    request = VetoPairs(
        database=Path("database.db"), model_dir=Path("model"), names=("1.jpg",), priors=priors
    )
    plain = json.loads(json.dumps(request.model_dump(mode="json")))
    assert REQUESTS["veto"].model_validate(plain) == request


def test_an_answer_is_of_the_type_that_its_request_names():
    veto = PairVeto(believed=True, oriented=True, informative=False, without=("1.jpg",))
    assert VetoPairs.read(json.loads(veto.model_dump_json())) == veto
    assert CalibrateViewGraph.read(False) is False
    assert MapGlobally.read(None) is None
    with pytest.raises(ValidationError):
        VetoPairs.read({"believed": True})
    with pytest.raises(ValidationError):
        MapGlobally.read(3)
