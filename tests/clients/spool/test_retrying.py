"""Refused photographs: sidecars that are corrected later, and mistyped scenes."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from fvs_client.spool.folder import find_file
from fvs_client.spool.outbox import CUT_OFF, FILE_NAME, Outbox
from fvs_client.spool.photograph import Photograph, Refusal, State
from fvs_client.spool.retrying import forget, retry
from fvs_client.spool.taking import take

_INVALID = Refusal("invalid-request", "latitude_deg: 95 is not a latitude.", "Correct it.")


@pytest.fixture
def outbox(tmp_path: Path) -> Iterator[Outbox]:
    with Outbox(tmp_path / FILE_NAME) as opened:
        yield opened


@pytest.fixture
def refused(outbox: Outbox, tmp_path: Path) -> Photograph:
    """A photograph whose metadata the service refused."""
    (tmp_path / "1.jpg").write_bytes(b"photograph")
    (tmp_path / "1.json").write_text('{"yaw_deg": 95.0}')
    taken = take(outbox, find_file(tmp_path / "1.jpg"), "scn_1")
    outbox.refuse(taken.number, _INVALID)
    return outbox.get(taken.number)


def test_a_corrected_sidecar_lets_a_refused_photograph_wait_again(
    outbox: Outbox, refused: Photograph, tmp_path: Path
) -> None:
    again = take(outbox, find_file(tmp_path / "1.jpg"), "scn_1")
    assert (again.number, again.state, again.refusal) == (refused.number, State.REFUSED, _INVALID)
    (tmp_path / "1.json").write_text('{"yaw_deg": 5.0}')
    again = take(outbox, find_file(tmp_path / "1.jpg"), "scn_1")
    assert (again.number, again.state, again.refusal) == (refused.number, State.WAITING, None)
    assert again.metadata == {"yaw_deg": 5.0}


@pytest.mark.parametrize("sidecar", [{"yaw_deg": 5.25}, None])
def test_a_retry_reads_the_sidecar_again(
    outbox: Outbox, refused: Photograph, tmp_path: Path, sidecar: dict[str, float] | None
) -> None:
    if sidecar is None:
        (tmp_path / "1.json").unlink()
    else:
        (tmp_path / "1.json").write_text(json.dumps(sidecar))
    (waiting,) = retry(outbox)
    assert (waiting.number, waiting.state, waiting.metadata) == (refused.number, State.WAITING, sidecar or {})


def test_a_retry_keeps_what_a_callback_said(outbox: Outbox, tmp_path: Path) -> None:
    from fvs_schema.images import ImageMetadata

    (tmp_path / "1.jpg").write_bytes(b"photograph")
    taken = take(outbox, find_file(tmp_path / "1.jpg"), "scn_1", lambda _: ImageMetadata(yaw_deg=7.0))
    outbox.refuse(taken.number, _INVALID)
    (waiting,) = retry(outbox)
    assert waiting.metadata == {"yaw_deg": 7.0}


def test_a_photograph_with_a_verdict_does_not_wait_again_by_itself(
    outbox: Outbox, refused: Photograph, tmp_path: Path
) -> None:
    outbox.refuse(refused.number, Refusal("too-small", "It is too small."), "too-small")
    (tmp_path / "1.json").write_text('{"yaw_deg": 5.0}')
    assert take(outbox, find_file(tmp_path / "1.jpg"), "scn_1").state is State.REFUSED


def test_photographs_for_a_mistyped_scene_are_forgotten(
    outbox: Outbox, refused: Photograph, tmp_path: Path
) -> None:
    other = take(outbox, find_file(tmp_path / "1.jpg"), "scn_2")
    assert forget(outbox, [other.number]) == []
    assert forget(outbox) == [refused]
    assert [photograph.scene for photograph in outbox.all()] == ["scn_2"]
    assert (tmp_path / "1.jpg").exists()


def test_a_retry_takes_a_file_that_is_whole_by_now_in_place_of_the_cut_off_one(
    outbox: Outbox, tmp_path: Path
) -> None:
    (tmp_path / "1.jpg").write_bytes(b"half")
    take(outbox, find_file(tmp_path / "1.jpg"), "scn_1", refusal=Refusal(CUT_OFF, "It has no end."))
    (tmp_path / "1.jpg").write_bytes(b"half and half")
    (waiting,) = retry(outbox)
    assert (waiting.size_bytes, waiting.state) == (13, State.WAITING)
    assert outbox.all() == [waiting]
