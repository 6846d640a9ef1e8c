import threading
import time

from fvs_service.jobs.model import JobKind
from fvs_service.worker.turns import Turns


def _never() -> bool:
    return False


def test_an_update_goes_before_a_fine_model_that_waited_longer() -> None:
    turns, order = Turns(), []
    assert turns.take("scene", JobKind.UPDATE, _never)

    def work(kind: JobKind) -> None:
        assert turns.take("scene", kind, _never)
        order.append(kind)
        turns.end("scene")

    fine = threading.Thread(target=work, args=(JobKind.FINE,))
    fine.start()
    update = threading.Thread(target=work, args=(JobKind.UPDATE,))
    update.start()
    while not turns.update_waits("scene"):
        time.sleep(0.01)
    turns.end("scene")
    for thread in (fine, update):
        thread.join()
    assert order == [JobKind.UPDATE, JobKind.FINE]
    assert not turns.update_waits("scene")


def test_scenes_do_not_wait_for_each_other() -> None:
    turns = Turns()
    assert turns.take("a", JobKind.FINE, _never)
    assert turns.take("b", JobKind.FINE, lambda: True)


def test_whoever_gives_up_has_no_turn() -> None:
    turns = Turns()
    assert turns.take("a", JobKind.UPDATE, _never)
    assert not turns.take("a", JobKind.UPDATE, lambda: True)
    turns.end("a")
    assert turns.take("a", JobKind.FINE, lambda: True)
