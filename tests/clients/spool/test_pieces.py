import random

from fvs_client.spool.pieces import Pieces


def test_pieces_take_as_long_as_they_should_on_the_link_as_it_is() -> None:
    now = [0.0]
    pieces = Pieces(clock=lambda: now[0])
    for rate, lowest, highest in (
        (20_000, 300_000, 400_001),
        (100_000_000, 8 << 20, 8 << 20),
        (100, 1, 64 << 10),
    ):
        offset = 0
        for _ in range(12):
            size = pieces.begin(1, offset, 1 << 30)
            pieces.sent(size)
            now[0] += size / rate
            offset += size
            pieces.arrived(1, offset)
        assert lowest <= size <= highest


def test_a_piece_ends_with_its_photograph() -> None:
    assert Pieces().begin(1, 0, 1_000) == 1_000


def test_what_arrives_of_a_broken_piece_does_not_make_pieces_smaller() -> None:
    pieces = Pieces(clock=lambda: 0.0)
    first = pieces.begin(1, 0, 1 << 30)
    pieces.sent(200_000)
    pieces.arrived(1, 190_000)
    assert pieces.begin(1, 190_000, 1 << 30) == first


def test_a_refusal_that_stopped_a_piece_does_not_make_pieces_smaller() -> None:
    pieces = Pieces(clock=lambda: 0.0)
    first = pieces.begin(1, 0, 1 << 30)
    pieces.sent(200_000)
    pieces.stopped()
    pieces.arrived(1, 0)
    assert pieces.begin(1, 0, 1 << 30) == first


def test_pieces_shrink_where_only_whole_ones_arrive() -> None:
    pieces, draw = Pieces(clock=lambda: 0.0), random.Random(0)
    offset, sent = 0, 0
    while offset < 200_000_000:
        size = pieces.begin(1, offset, 1 << 30)
        until_break = int(draw.expovariate(1 / 500_000))
        pieces.sent(min(size, until_break))
        sent += min(size, until_break)
        offset += size if until_break > size else 0
        pieces.arrived(1, offset)
    assert sent < 1.15 * offset


def test_the_offset_of_another_photograph_says_nothing_of_a_piece() -> None:
    pieces = Pieces(clock=lambda: 0.0)
    first = pieces.begin(1, 0, 1 << 30)
    pieces.sent(first)
    pieces.arrived(2, 0)
    assert pieces.begin(1, 0, 1 << 30) == first
