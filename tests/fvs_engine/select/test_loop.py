"""The loop on a synthetic room with known poses, and on photographs with structure from motion."""

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from selection_loops import loop_opener, run_to_end, smallest_scene

from fvs_engine.errors import (
    Cancelled,
    InvalidInputError,
    OutputExistsError,
    ReconstructionError,
    StorageError,
)
from fvs_engine.geometry import angle_between
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset, open_dataset, read_dataset
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.select.candidate_views import align
from fvs_engine.select.loop import SelectionLoop, StepRecord, StopReason
from fvs_engine.sfm.settings import FeatureSettings, SfmSettings
from fvs_engine.splat.views import TrainingView
from fvs_schema.findings import FindingCode

pytestmark = pytest.mark.usefixtures("all_native_here")

SCENE = smallest_scene(initial_iterations=4, iterations_per_view=1)
open_loop = loop_opener(scene=SCENE, initial=4, budget=8, nearest=6)


def without_seconds(loop: SelectionLoop) -> list[dict[str, Any]]:
    """What a selection decided, and what it learned."""
    return [record.model_dump(exclude={"seconds": True, "choice": {"seconds"}}) for record in loop.records]


@pytest.fixture(scope="module")
def clean_run(room: Dataset, tmp_path_factory: pytest.TempPathFactory) -> SelectionLoop:
    """One selection that was not interrupted. Tests must not change it."""
    loop = open_loop(tmp_path_factory.mktemp("clean"), room)
    loop.stop = run_to_end(loop)  # type: ignore[attr-defined]
    return loop


def test_it_visits_as_many_views_as_the_budget_says(clean_run: SelectionLoop) -> None:
    assert clean_run.stop.kind == "budget"  # type: ignore[attr-defined]
    assert len(clean_run.visited) == len(set(clean_run.visited)) == 8
    assert clean_run.visited[:4] == ("01.png", "02.png", "03.png", "04.png")
    assert [record.views for record in clean_run.records] == [5, 6, 7, 8]
    assert [record.registered for record in clean_run.records] == [5, 6, 7, 8]


def test_photographs_are_measured_before_they_are_learnt_and_make_a_forecast(
    clean_run: SelectionLoop,
) -> None:
    choices = [record.choice for record in clean_run.records]
    assert all(choice.before_db is not None and 0 < choice.before_db < 60 for choice in choices)
    assert all(0 < choice.variance < 1 for choice in choices)
    assert [choice.outlook.now.forecast is None for choice in choices] == [True, True, True, False]
    variances = [choice.outlook.now.variance for choice in choices]
    assert variances == sorted(variances, reverse=True)
    last = choices[-1].outlook
    assert last.end.variance <= last.after_next.variance + 1e-9 < last.now.variance
    assert last.gain_db is not None
    assert last.gain_db > 0


def test_it_ends_when_the_expected_quality_or_gain_says_so(
    room: Dataset, tmp_path: Path, clean_run: SelectionLoop
) -> None:
    by_quality = open_loop(tmp_path / "quality", room, stop_at_db=1.0)
    assert run_to_end(by_quality).kind == "quality"
    assert by_quality.visited == clean_run.visited[:7]  # after three photographs there is a forecast
    by_gain = open_loop(tmp_path / "gain", room, stop_at_gain_db=99.0)
    assert run_to_end(by_gain).kind == "gain"


def test_test_views_are_neither_visited_nor_candidates(clean_run: SelectionLoop) -> None:
    held_out = {"00.png", "08.png", "16.png"}
    assert set(clean_run.held_out_names) == held_out
    assert not held_out & set(clean_run.visited)
    for record in clean_run.records:
        assert not held_out & {place.name for place in record.choice.ranked}


def test_candidates_are_the_unvisited_views_in_reach_of_the_camera(clean_run: SelectionLoop) -> None:
    centres = clean_run.dataset.centres()
    visited = list(clean_run.initial)
    for record in clean_run.records:
        lengths = {
            name: float(np.linalg.norm(centres[name] - centres[visited[-1]]))
            for name in clean_run.pool
            if name not in visited
        }
        nearest = sorted(lengths.values())[:6]
        found = {place.name: place.distance for place in record.choice.ranked}
        assert sorted(found.values()) == pytest.approx(nearest)
        assert found == pytest.approx({name: lengths[name] for name in found})
        visited.append(record.chosen)


def test_the_lowest_score_is_chosen(clean_run: SelectionLoop) -> None:
    for record in clean_run.records:
        ranked = [place for place in record.choice.ranked if place.rank is not None]
        assert record.choice.fallback is None
        assert record.choice.score == min(place.score for place in ranked if place.score is not None)
        assert record.chosen == ranked[0].name


def test_travel_is_the_way_through_all_visited_centres(clean_run: SelectionLoop) -> None:
    centres = clean_run.dataset.centres()
    way = np.stack([centres[name] for name in clean_run.visited])
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    assert clean_run.travel == pytest.approx(steps.sum())
    for record, travel, step in zip(clean_run.records, np.cumsum(steps)[3:], steps[3:], strict=True):
        assert record.travel == pytest.approx(travel)
        assert record.choice.distance == pytest.approx(step)


def test_training_follows_the_schedule(clean_run: SelectionLoop) -> None:
    assert [record.iterations for record in clean_run.records] == [5, 6, 7, 8]


@pytest.mark.parametrize("pause", ["after every step", "after every choice"])
def test_a_selection_that_is_opened_again_goes_on_as_if_nothing_had_happened(
    room: Dataset, clean_run: SelectionLoop, tmp_path: Path, pause: str
) -> None:
    for _ in range(20):
        loop = open_loop(tmp_path, room)
        if pause == "after every choice":
            loop._visit = _stop_there  # type: ignore[method-assign]
            try:
                loop.step(Monitor())
            except Cancelled:
                loop = open_loop(tmp_path, room)
        if isinstance(loop.step(Monitor()), StopReason):
            break
    assert without_seconds(loop) == without_seconds(clean_run)


def _stop_there(*_arguments: object) -> StepRecord:
    raise Cancelled("Stopped between the choice and the visit.")


def test_cancelling_anywhere_changes_nothing(room: Dataset, clean_run: SelectionLoop, tmp_path: Path) -> None:
    """Stop requests that come at the 1st, 3rd, 9th, … report of runs that follow each other."""

    class Impatient(Monitor):
        def __init__(self, patience: int) -> None:
            super().__init__(lambda _progress: self._count())
            self._left = patience

        def _count(self) -> None:
            self._left -= 1
            if self._left <= 0:
                self.cancel()

    for patience in (1, 3, 9, 15, 20, 25):
        loop, monitor = open_loop(tmp_path, room), Impatient(patience)
        with pytest.raises(Cancelled):
            run_to_end(loop, monitor)
    last = open_loop(tmp_path, room)
    run_to_end(last)
    assert without_seconds(last) == without_seconds(clean_run)


def test_another_seed_and_method_may_choose_otherwise_but_not_in_the_same_folder(
    room: Dataset, tmp_path: Path
) -> None:
    open_loop(tmp_path / "a", room, method="random", budget=5)
    with pytest.raises(OutputExistsError, match="seed was 0 and is 1"):
        open_loop(tmp_path / "a", room, method="random", budget=5, seed=1)
    with pytest.raises(OutputExistsError, match="method was random and is farthest"):
        open_loop(tmp_path / "a", room, method="farthest", budget=5)
    with pytest.raises(OutputExistsError, match="hold_out was every and is random"):
        open_loop(tmp_path / "a", room, method="random", budget=5, hold_out="random")
    scene = SCENE.model_copy(update={"iterations_per_view": 2})
    with pytest.raises(OutputExistsError, match=r"scene\.iterations_per_view was 1 and is 2"):
        open_loop(tmp_path / "a", room, method="random", budget=5, scene=scene)


def test_the_time_limit_and_the_threads_may_change(room: Dataset, tmp_path: Path) -> None:
    open_loop(tmp_path, room).begin(Monitor())
    threads = SCENE.model_copy(update={"sfm": SfmSettings(threads=2)})
    resumed = open_loop(tmp_path, room, time_limit_s=3.0, scene=threads)
    assert resumed.visited == resumed.initial


def test_what_there_is_to_say_of_the_initial_views_is_said_once(room: Dataset, tmp_path: Path) -> None:
    loop = open_loop(tmp_path, room, initial=2)
    (warning,) = loop.begin(Monitor())
    assert (warning.code, warning.numbers["views"]) == (FindingCode.FEW_STARTS, 2)
    assert loop.begin(Monitor()) == ()


def test_a_time_limit_ends_it_and_a_later_run_goes_on(room: Dataset, tmp_path: Path) -> None:
    limited = open_loop(tmp_path, room, time_limit_s=1e-6)
    assert run_to_end(limited).kind == "time-limit"
    assert limited.records == ()
    assert json.loads((tmp_path / "selection.json").read_text())["stop"]["kind"] == "time-limit"
    later = open_loop(tmp_path, room)
    assert isinstance(later.step(Monitor()), StepRecord)
    assert json.loads((tmp_path / "selection.json").read_text())["stop"] is None


def test_it_ends_where_nothing_is_left_in_reach(room: Dataset, tmp_path: Path) -> None:
    """The rounds stand 0.3 units above each other, views 0.8 apart: one step up, and there is no other."""
    loop = open_loop(tmp_path, room, initial=3, nearest=None, radius=0.5, budget=20)
    stop = run_to_end(loop)
    assert loop.visited == ("01.png", "02.png", "03.png", "15.png")
    assert stop.kind == "nothing-in-reach"
    assert "within 0.5 of the camera; a radius of 0.8" in stop.message


def test_a_radius_that_reaches_nothing_is_refused_before_anything_is_learned(
    room: Dataset, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInputError, match=r"within 0\.1 of the camera; a radius of 0\.\d+ would"):
        open_loop(tmp_path / "out", room, nearest=None, radius=0.1)
    assert not (tmp_path / "out").exists()


def test_without_radius_or_number_the_reach_comes_from_the_capture(room: Dataset, tmp_path: Path) -> None:
    loop = open_loop(tmp_path, room, nearest=None)
    centres = np.stack(list(room.centres().values()))
    spacing = np.median(np.linalg.norm(np.diff(centres, axis=0), axis=1))
    assert loop.reach.radius == pytest.approx(8 * spacing)


def test_a_pool_smaller_than_the_budget_is_refused(room: Dataset, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="only 21 to visit: 24 photographs") as caught:
        open_loop(tmp_path / "out", room, budget=22)
    assert "at most 21" in caught.value.hint
    assert not (tmp_path / "out").exists()


def test_the_whole_pool_may_be_visited(room: Dataset, tmp_path: Path) -> None:
    scene = SCENE.model_copy(update={"iterations_per_view": 0, "initial_iterations": 1})
    loop = open_loop(tmp_path, room, initial=19, budget=21, nearest=100, scene=scene, method="random")
    assert run_to_end(loop).kind == "budget"
    assert sorted(loop.visited) == sorted(loop.pool)


def test_a_folder_with_something_else_in_it_is_left_alone(room: Dataset, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputExistsError, match=r"thesis\.tex"):
        open_loop(tmp_path, room)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_other_photographs_are_not_mixed_in(room: Dataset, room_dir: Path, tmp_path: Path) -> None:
    shutil.copytree(room_dir, tmp_path / "room")
    with (tmp_path / "room" / "images" / "05.png").open("ab") as photograph:
        photograph.write(b" ")
    other = read_dataset(tmp_path / "room" / "images", colmap=tmp_path / "room" / "sparse")
    open_loop(tmp_path / "out", room)
    with pytest.raises(OutputExistsError, match="photographs, masks or poses differ"):
        open_loop(tmp_path / "out", other)


@pytest.mark.parametrize("damage", ["{", '{"choice": null, "record": null}', ""])
def test_a_damaged_step_is_named(
    room: Dataset, clean_run: SelectionLoop, tmp_path: Path, damage: str
) -> None:
    folder = tmp_path / "out"
    shutil.copytree(clean_run._folder.root, folder)
    (folder / "steps" / "0002.json").write_text(damage)
    with pytest.raises(StorageError, match=r"0002\.json cannot be used"):
        open_loop(folder, room)


def test_a_step_that_is_missing_is_noticed(room: Dataset, clean_run: SelectionLoop, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    shutil.copytree(clean_run._folder.root, folder)
    (folder / "steps" / "0002.json").unlink()
    with pytest.raises(StorageError, match="step 2 is missing"):
        open_loop(folder, room)


ESTIMATED_SCENE = SceneSettings(
    poses="sfm",
    long_side_px=96,
    initial_iterations=20,
    iterations_per_view=5,
    quick_share=1.0,
    sfm=SfmSettings(threads=1, features_of_few=FeatureSettings(max_features=2000)),
)
ESTIMATED = {"scene": ESTIMATED_SCENE, "initial": 4, "budget": 5, "nearest": 1}


@pytest.fixture(scope="module")
def yard(yard_dir: Path) -> Dataset:
    """Nine photographs and where they were taken, in metres; the first and the last are held out."""
    return open_dataset(yard_dir)


@pytest.fixture(scope="module")
def yard_begun(yard: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a selection that knows its four initial views. Read-only."""
    folder = tmp_path_factory.mktemp("yard_begun")
    open_loop(folder, yard, **ESTIMATED).begin(Monitor())
    return folder


@pytest.mark.system
def test_photographs_register_and_candidates_land_in_the_model(
    yard: Dataset, yard_begun: Path, tmp_path: Path
) -> None:
    """Poses come from the visited photographs alone, in a frame of their own."""
    folder = shutil.copytree(yard_begun, tmp_path / "out")
    loop = open_loop(folder, yard, **ESTIMATED)
    record = loop.step(Monitor())
    assert isinstance(record, StepRecord)
    assert (record.chosen, record.registered, record.warnings) == ("0005.jpg", 5, ())
    centres = np.stack([yard.by_name[name].centre for name in loop.initial])
    spread = np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert record.alignment.views == 4
    assert record.alignment.rms < 0.05 * spread
    assert record.alignment.attitude_deg < 2.0

    def apart(view: TrainingView) -> tuple[float, float]:
        """Distance of a photograph's pose from its candidate's: in units of the dataset, in degrees."""
        found = view.camera_from_model.inverse()
        expected = model_from_world.move_camera(yard.by_name[view.name].camera_from_model.inverse())
        moved = np.linalg.norm(found.translation - expected.translation) / model_from_world.scale
        return float(moved), float(np.degrees(angle_between(found.rotation, expected.rotation)))

    # The chosen photograph was registered by itself, a held-out one is placed by itself.
    model_from_world = align(loop.scene).model_from_world
    held_out = loop.scene.localise(loop.held_out_names, Monitor())
    assert "0000.jpg" in held_out
    for view in (loop.scene.views[-1], held_out["0000.jpg"]):
        moved, turned = apart(view)
        assert moved < 0.1 * spread
        assert turned < 3.0
    assert not set(loop.held_out_names) & set(loop.scene.visited)


def test_poses_that_contradict_the_photographs_are_refused(
    yard: Dataset, yard_begun: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(yard_begun, tmp_path / "out")
    loop = open_loop(folder, yard, **ESTIMATED)
    mixed = [yard.views[place] for place in (0, 3, 1, 4, 2, 5, 6, 7, 8)]
    views = [
        dataclasses.replace(view, camera_from_model=other.camera_from_model)
        for view, other in zip(yard.views, mixed, strict=True)
    ]
    loop.dataset = dataclasses.replace(yard, views=tuple(views))
    loop.scene.dataset = loop.dataset
    with pytest.raises(InvalidInputError, match=r"(contradict|cannot be aligned with) the photographs"):
        loop.step(Monitor())
    assert loop.records == ()


@pytest.mark.system
def test_a_photograph_that_shares_too_little_waits_and_is_named(yard: Dataset, tmp_path: Path) -> None:
    images = shutil.copytree(yard.image_dir, tmp_path / "images")
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    Image.fromarray(noise).save(images / "0007.jpg")
    spoilt = dataclasses.replace(yard, image_dir=images)
    farthest = ESTIMATED | {"method": "farthest", "nearest": 3}
    record = open_loop(tmp_path / "near", spoilt, **farthest).step(Monitor())
    assert isinstance(record, StepRecord)
    assert record.chosen != "0007.jpg"  # what it would show was seen from too far aside
    loop = open_loop(tmp_path / "out", spoilt, **farthest, registrable=False)
    record = loop.step(Monitor())
    assert isinstance(record, StepRecord)
    assert record.chosen == "0007.jpg"
    assert (record.registered, record.unregistered, record.iterations) == (4, 1, 20)
    (warning,) = record.warnings
    assert (warning.code, warning.images) == (FindingCode.UNMATCHED, ("0007.jpg",))


def test_initial_views_that_do_not_overlap_are_refused(yard: Dataset, tmp_path: Path) -> None:
    """One photograph of the place, one of noise: nothing joins them."""
    images = shutil.copytree(yard.image_dir, tmp_path / "images")
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    Image.fromarray(noise).save(images / "0001.jpg")
    strangers = dataclasses.replace(yard, image_dir=images)
    loop = open_loop(
        tmp_path / "out", strangers, scene=ESTIMATED_SCENE, initial=2, budget=3, nearest=3, test_every=0
    )
    with pytest.raises(ReconstructionError, match="overlap"):
        loop.step(Monitor())
