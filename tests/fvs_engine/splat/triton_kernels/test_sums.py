"""Rows of hits are added up by splat, to the same bits whoever its neighbours are."""

import pytest
import torch
from torch import Tensor

from fvs_engine.splat.triton_kernels.binning import Hits
from fvs_engine.splat.triton_kernels.sums import FEW, MANY, SPLATS, sum_hits

CAMERAS, COUNT = 2, 25


@pytest.fixture
def numbers() -> Tensor:
    """Hits of each splat in depth order: none, few, all that are few, and many."""
    numbers = torch.randint(0, 7, (CAMERAS * COUNT,), generator=torch.Generator().manual_seed(0))
    numbers[20:24] = 0
    numbers[[3, 4, 5, 30]] = torch.tensor([FEW.value, FEW.value + 1, FEW.value + 2 * MANY.value + 3, 200])
    return numbers


def hits_of(numbers: Tensor, order: Tensor, capacity: int, device: torch.device) -> Hits:
    """What the sums read of the hits."""
    starts = torch.cat([torch.zeros(1, dtype=torch.int64), numbers.cumsum(0)])
    unread = torch.empty(0, dtype=torch.int32)
    hits = Hits(unread, unread, torch.empty(capacity, dtype=torch.int32), order, starts)
    return Hits(**{name: tensor.to(device) for name, tensor in vars(hits).items()})


def an_order(cameras: int, count: int) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.stack([torch.randperm(count, generator=generator) for _ in range(cameras)])


@pytest.mark.parametrize("missing", [0, 60], ids=["room for all", "overflow"])
@pytest.mark.parametrize("width", [10, 16])
def test_hits_are_added_up_by_splat(numbers, width, missing, device):
    order = an_order(CAMERAS, COUNT)
    capacity = int(numbers.sum()) - missing
    rows = torch.randn(capacity, width, generator=torch.Generator().manual_seed(2))
    expected = torch.zeros(CAMERAS * COUNT, width, dtype=torch.float64)
    splats = (order + COUNT * torch.arange(CAMERAS)[:, None]).reshape(-1)
    expected.index_add_(0, splats.repeat_interleave(numbers)[:capacity], rows.double())
    found = sum_hits(rows.to(device), hits_of(numbers, order, capacity, device))
    assert torch.allclose(found.cpu().double(), expected.reshape(CAMERAS, COUNT, width), rtol=0, atol=3e-5)


def test_neighbours_change_no_bit(numbers, device):
    rows = torch.randn(int(numbers.sum()), 10, generator=torch.Generator().manual_seed(2))
    chosen = 5  # has many hits
    count = len(numbers)
    inside = torch.arange(count)[None]
    together = sum_hits(rows.to(device), hits_of(numbers, inside, len(rows), device))
    start = int(numbers[:chosen].sum())
    own = rows[start : start + int(numbers[chosen])]
    alone = sum_hits(own.to(device), hits_of(numbers[chosen : chosen + 1], inside[:, :1], len(own), device))
    assert torch.equal(together[0, chosen], alone[0, 0])
    assert chosen % SPLATS != 0


def test_nothing_to_add_up(device):
    none = hits_of(torch.zeros(3, dtype=torch.int64), an_order(1, 3), 0, device)
    assert torch.equal(sum_hits(torch.empty(0, 10, device=device), none).cpu(), torch.zeros(1, 3, 10))
    empty = hits_of(torch.zeros(0, dtype=torch.int64), an_order(1, 0), 0, device)
    assert sum_hits(torch.empty(0, 10, device=device), empty).shape == (1, 0, 10)
