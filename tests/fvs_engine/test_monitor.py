import pytest

from fvs_engine.errors import Cancelled
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.splat.session import SavingMonitor


def test_a_saving_monitor_passes_on_and_saves_when_it_is_time() -> None:
    reports: list[Progress] = []
    saves: list[int] = []
    outer = Monitor(reports.append)
    saving = SavingMonitor(outer, lambda: saves.append(1), every_s=0.0)
    saving.report("training", 3, 9, loss=0.5)
    saving.check()
    saving.check()
    assert reports == [Progress("training", 3, 9, {"loss": 0.5})]
    assert len(saves) == 2
    rarely = SavingMonitor(outer, lambda: saves.append(1), every_s=1e6)
    rarely.check()
    assert len(saves) == 2


def test_a_saving_monitor_is_cancelled_with_its_outer_one() -> None:
    outer = Monitor()
    saving = SavingMonitor(outer, lambda: None, every_s=1e6)
    saving.cancel()
    assert outer.cancelled
    assert saving.cancelled
    with pytest.raises(Cancelled):
        saving.check()
