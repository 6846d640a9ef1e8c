import threading
import time

from fvs_service.jobs.model import JobKind
from fvs_service.worker.scene_slots import SceneSlots


def _never() -> bool:
    return False


def test_an_update_goes_before_a_fine_model_that_waited_longer() -> None:
    slots, order = SceneSlots(), []
    assert slots.acquire("scene", JobKind.UPDATE, _never)

    def work(kind: JobKind) -> None:
        assert slots.acquire("scene", kind, _never)
        order.append(kind)
        slots.release("scene")

    fine = threading.Thread(target=work, args=(JobKind.FINE,))
    fine.start()
    update = threading.Thread(target=work, args=(JobKind.UPDATE,))
    update.start()
    while not slots.update_waits("scene"):
        time.sleep(0.01)
    slots.release("scene")
    for thread in (fine, update):
        thread.join()
    assert order == [JobKind.UPDATE, JobKind.FINE]
    assert not slots.update_waits("scene")


def test_scenes_do_not_wait_for_each_other() -> None:
    slots = SceneSlots()
    assert slots.acquire("a", JobKind.FINE, _never)
    assert slots.acquire("b", JobKind.FINE, lambda: True)


def test_a_job_that_gives_up_has_no_slot() -> None:
    slots = SceneSlots()
    assert slots.acquire("a", JobKind.UPDATE, _never)
    assert not slots.acquire("a", JobKind.UPDATE, lambda: True)
    slots.release("a")
    assert slots.acquire("a", JobKind.FINE, lambda: True)
