"""The order of turns, as a simulation of workers that take jobs and pause them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from fvs_service.jobs.order import OpenJob, Order
from hypothesis import given
from hypothesis import strategies as st

from fvs_schema.jobs import JobKind, WaitReason

UPDATE, FINE = JobKind.UPDATE, JobKind.FINE
TURN_MS = 30_000


def _job(name: str, tenant: str, kind: JobKind = UPDATE, scene: str | None = None, **more: object) -> OpenJob:
    values = {"waiting_since_ms": 0, **more}
    return OpenJob(id=name, tenant_id=tenant, scene_id=scene or f"scene of {name}", kind=kind, **values)  # type: ignore[arg-type]


def _order(
    jobs: Sequence[OpenJob], served: Mapping[str, int] | None = None, limit: int = 8, now_ms: int = 60_000
) -> Order:
    return Order(jobs, served or {}, limit, TURN_MS, now_ms)


def _names(order: Order) -> list[str]:
    return [place.job.id for place in order.line]


def test_tenants_take_turns() -> None:
    jobs = [_job(f"a{n}", "a") for n in range(4)] + [_job("b0", "b"), _job("c0", "c"), _job("c1", "c")]
    assert _names(_order(jobs)) == ["a0", "b0", "c0", "a1", "c1", "a2", "a3"]


def test_the_tenant_that_was_served_last_comes_last() -> None:
    jobs = [_job("a0", "a"), _job("b0", "b"), _job("c0", "c")]
    assert _names(_order(jobs, {"a": 30, "b": 10, "c": 20})) == ["b0", "c0", "a0"]


def test_a_tenant_with_fewer_running_jobs_goes_first_whoever_was_served_last() -> None:
    running = _job("a9", "a", worker_id="w", taken_at_ms=1)
    jobs = [running, _job("a0", "a"), _job("b0", "b")]
    assert _names(_order(jobs, {"a": 1, "b": 50_000})) == ["b0", "a0"]


def test_updates_go_before_fine_models_and_scenes_take_turns() -> None:
    jobs = [
        _job("1", "a", FINE),
        _job("2", "a", served_ms=20),
        _job("3", "a", served_ms=10),
        _job("4", "a", served_ms=0),
    ]
    assert _names(_order(jobs)) == ["4", "3", "2", "1"]


def test_a_job_that_has_begun_goes_on_before_others_of_its_tenant_begin() -> None:
    jobs = [_job("1", "a"), _job("2", "a", begun=True, served_ms=50), _job("3", "a", FINE, begun=True)]
    assert _names(_order(jobs)) == ["2", "1", "3"]


def test_a_fine_model_that_waited_for_long_counts_as_an_update() -> None:
    jobs = [_job("1", "a", FINE), _job("2", "a", waiting_since_ms=699_000)]
    assert _names(_order(jobs, now_ms=700_000)) == ["1", "2"]


def test_a_scene_has_one_turn_at_a_time() -> None:
    jobs = [
        _job("update", "a", scene="s", worker_id="w", taken_at_ms=1),
        _job("fine", "a", FINE, scene="s"),
        _job("other", "a", FINE),
    ]
    order = _order(jobs)
    assert [(place.job.id, place.obstacle) for place in order.line] == [
        ("other", None),
        ("fine", WaitReason.SCENE),
    ]


def test_a_tenant_runs_no_more_jobs_than_it_may() -> None:
    running = [_job(f"a{n}", "a", worker_id=f"w{n}") for n in range(2)]
    order = _order([*running, _job("a2", "a"), _job("b0", "b"), _job("b1", "b"), _job("b2", "b")], limit=2)
    assert {place.job.id: place.obstacle for place in order.line} == {
        "a2": WaitReason.TENANT_LIMIT,
        "b0": None,
        "b1": None,
        "b2": WaitReason.TENANT_LIMIT,
    }
    assert order.next is not None
    assert order.next.id == "b0"


def test_what_a_job_lacks_does_not_hold_the_tenants_other_jobs() -> None:
    poor = _job("a0", "a", obstacle=WaitReason.MEMORY, not_before_ms=61_000)
    order = _order([poor, _job("a1", "a")])
    assert order.next is not None
    assert order.next.id == "a1"
    assert _order([poor], now_ms=62_000).next is poor


def test_a_long_job_makes_room_for_another_tenant_once_its_turn_is_over() -> None:
    for kind in JobKind:
        running = _job("a0", "a", kind, worker_id="w", taken_at_ms=1_000)
        jobs = [running, _job("b0", "b")]
        assert not _order(jobs, now_ms=1_000 + TURN_MS - 1).turn_ends(running)
        assert _order(jobs, now_ms=1_000 + TURN_MS).turn_ends(running)
        assert not _order([running, _job("a1", "a", FINE)], now_ms=90_000).turn_ends(running)


def test_of_the_jobs_that_could_make_room_one_does() -> None:
    running = [
        _job("a0", "a", FINE, worker_id="w0", taken_at_ms=1_000),
        _job("b0", "b", FINE, worker_id="w1", taken_at_ms=2_000),
        _job("b1", "b", worker_id="w2", taken_at_ms=1_500),
    ]
    order = _order([*running, _job("c0", "c")], now_ms=90_000)
    assert [job.id for job in running if order.turn_ends(job)] == ["b0"]


def test_a_fine_model_makes_room_for_an_update_of_its_scene_at_once_unless_it_waited_for_long() -> None:
    update = _job("update", "a", scene="s", waiting_since_ms=59_999)
    fine = _job("fine", "a", FINE, scene="s", worker_id="w", taken_at_ms=59_000, waiting_since_ms=50_000)
    assert _order([fine, update]).update_of_scene_waits(fine)
    starved = replace(fine, taken_at_ms=900_000, waiting_since_ms=0)
    assert not _order([starved, update], now_ms=901_000).update_of_scene_waits(starved)
    assert _order([starved, update], now_ms=931_000).update_of_scene_waits(starved)


def test_frames_are_taken_whatever_waits_for_them() -> None:
    """An update that each frame asks for would interrupt the job again and again, before its last frame."""
    frames = _job("1", "a", JobKind.FRAMES, "s", worker_id="w", taken_at_ms=0)
    waiting = [_job("2", "a", UPDATE, "s"), _job("3", "a", FINE, "s")]
    order = _order([frames, *waiting], now_ms=TURN_MS // 2)
    assert not order.update_of_scene_waits(frames)
    assert {place.obstacle for place in order.line} == {WaitReason.SCENE}
    queued = _job("1", "a", JobKind.FRAMES, "s")
    assert _names(_order([*waiting, queued])) == ["1", "2", "3"]


def _simulate(
    jobs: dict[str, OpenJob], work_ms: dict[str, int], slots: int, limit: int, until: str | None = None
) -> dict[str, int]:
    """When each job ends, or those up to ``until``, if ``slots`` workers follow the order."""
    now_ms, ended, served = 1_000_000, {}, Counter[str]()
    left = dict(work_ms)
    jobs = {name: replace(job, waiting_since_ms=now_ms) for name, job in jobs.items()}
    step_ms = 5_000
    for _ in range(200_000 // step_ms * len(jobs) + 1000):
        for job in [one for one in jobs.values() if one.worker_id is not None]:
            left[job.id] -= step_ms
            if left[job.id] <= 0:
                ended[job.id] = now_ms
                del jobs[job.id]
        for name in list(jobs):
            order = _order(list(jobs.values()), served, limit, now_ms)
            job = jobs[name]
            if job.worker_id is not None and (order.turn_ends(job) or order.update_of_scene_waits(job)):
                jobs[name] = replace(job, worker_id=None, waiting_since_ms=now_ms)
        while sum(job.worker_id is not None for job in jobs.values()) < slots:
            chosen = _order(list(jobs.values()), served, limit, now_ms).next
            if chosen is None:
                break
            taken = replace(chosen, worker_id="w", taken_at_ms=now_ms, served_ms=now_ms)
            jobs[chosen.id] = taken
            served[chosen.tenant_id] = now_ms
            running = [job for job in jobs.values() if job.worker_id is not None]
            assert len({job.scene_id for job in running}) == len(running)
            assert max(Counter(job.tenant_id for job in running).values()) <= limit
        if not jobs or until in ended:
            return ended
        now_ms += step_ms
    raise AssertionError(f"starved: {jobs}")


_JOBS = st.lists(
    st.tuples(st.sampled_from("abc"), st.integers(0, 2), st.sampled_from(list(JobKind)), st.integers(1, 150)),
    min_size=1,
    max_size=12,
    unique_by=lambda job: job[:3],
)


@given(_JOBS, st.integers(1, 3), st.integers(1, 3))
def test_every_job_ends(wanted: list[tuple[str, int, JobKind, int]], slots: int, limit: int) -> None:
    jobs, work = {}, {}
    for number, (tenant, scene, kind, seconds) in enumerate(wanted):
        name = f"{number:02d}"
        jobs[name] = _job(name, tenant, kind, scene=f"{tenant}{scene}")
        work[name] = 1000 * seconds
    assert _simulate(jobs, work, slots, limit).keys() == work.keys()


def test_a_small_job_waits_for_one_turn_however_many_others_there_are() -> None:
    jobs = {f"a{n:02d}": _job(f"a{n:02d}", "a", FINE if n % 2 else UPDATE) for n in range(30)}
    jobs["b"] = _job("b", "b")
    ended = _simulate(jobs, {name: 5_000 if name == "b" else 600_000 for name in jobs}, 1, 8, until="b")
    assert ended["b"] <= 1_000_000 + TURN_MS + 3 * 5_000
