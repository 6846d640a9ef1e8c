import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from fvs_engine.errors import StorageError
from fvs_engine.files.record import write_record
from fvs_engine.lab.evaluate.markdown import markdown
from fvs_engine.lab.evaluate.protocol import PRESETS
from fvs_engine.lab.evaluate.report import Summary, summarise
from fvs_engine.lab.evaluate.results import Run, read_result

MakeRun = Callable[..., Run]


@pytest.fixture
def summary(make_run: MakeRun) -> Summary:
    runs = []
    for seed, luck in enumerate((0.0, 1.0, 5.0)):
        correlations = {"farthest": 0.1 * seed, "fisher": -0.4, "random": None}
        runs.append(make_run("farthest", seed, {10: 18 + luck, 20: 20 + luck}, correlations=correlations))
        runs.append(make_run("fisher", seed, {10: 17 + luck, 20: 19 + luck}))
        runs.append(make_run("random", seed, {10: 19 - luck, 20: 18 - luck}))
    return summarise("room", PRESETS["fisherrf"], runs, ["a note"])


def test_rows_are_means_over_seeds_best_first(summary: Summary) -> None:
    at_20 = [row for row in summary.rows if row.visited == 20]
    assert [row.method for row in at_20] == ["farthest", "fisher", "random"]
    farthest, fisher, random = at_20
    assert farthest.psnr_db.mean == pytest.approx(22.0)
    assert farthest.travel.mean == 40.0
    assert farthest.selection_s is not None
    assert farthest.selection_s.mean == 0.5
    assert "farthest" not in farthest.gains
    assert fisher.gains["farthest"].mean == pytest.approx(-1.0)
    assert fisher.gains["farthest"].half_width == pytest.approx(0.0, abs=1e-9)
    assert random.gains["farthest"].mean == pytest.approx(-6.0)


def test_correlations_leave_out_what_is_not_defined(summary: Summary) -> None:
    found = {(row.method, row.visited): row.all_candidates for row in summary.correlations}
    farthest, random = found["farthest", 20], found["random", 20]
    assert farthest is not None
    assert (farthest.mean, farthest.count) == (pytest.approx(0.1), 3)
    assert random is None


def test_a_summary_survives_the_disk(summary: Summary, tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    assert read_result(path, Summary) is None
    write_record(path, summary)
    assert read_result(path, Summary) == summary
    path.write_text(path.read_text()[:-100])
    with pytest.raises(StorageError, match=r"report\.json"):
        read_result(path, Summary)


def test_reports_of_an_earlier_version_have_no_unvisited_views(make_run: MakeRun, tmp_path: Path) -> None:
    path, run = tmp_path / "run.json", make_run("farthest", 0, {20: 20.0})
    stored = json.loads(run.model_dump_json())
    for evaluation in stored["evaluations"]:
        del evaluation["unvisited_db"], evaluation["repeats"]
    path.write_text(json.dumps(stored))
    earlier = read_result(path, Run)
    assert earlier == run
    assert "unvisited dB" not in markdown(summarise("room", PRESETS["paper"], [earlier]))


def test_the_table_says_all_of_it(summary: Summary) -> None:
    text = markdown(summary)
    (line,) = re.findall(r"^\| farthest \| \*\*22\.00 .*$", text, re.MULTILINE)
    assert "± 6.57" in line  # deviation 2.6458 / √3 × 4.3027
    assert "**40.00 ± 0.00**" in line
    assert "−1.00 ± 0.00" in text
    assert text.index("## 20 views") < text.index("## 10 views")
    assert "| random | – | – |" in text
    assert "- a note" in text
    assert "LPIPS" not in text


def test_lpips_has_a_column_where_it_is_known(make_run: MakeRun) -> None:
    text = markdown(summarise("room", PRESETS["paper"], [make_run("farthest", 0, {20: 20.0}, lpips=0.25)]))
    assert "| LPIPS |" in text
    assert "| 0.250 |" in text


def test_estimated_poses_say_how_well_they_fit(make_run: MakeRun) -> None:
    run = make_run("farthest", 0, {20: 20.0})
    (last,) = run.evaluations
    guessed = last.model_copy(update={"aligned_only": ("a.png", "b.png")})
    estimated = run.model_copy(update={"worst_rms": 0.0123, "evaluations": (guessed,)})
    text = markdown(summarise("room", PRESETS["paper"], [estimated]))
    assert "| registered views | test views only aligned | worst alignment RMS |" in text
    assert "| 20.0 | 2.0 | 0.0123 | 1 |" in text
    assert "a.png, b.png" in text
    known = markdown(summarise("room", PRESETS["fisherrf"], [run]))
    assert "aligned" not in known
    assert "registered" not in known


def test_only_the_selectors_with_the_most_runs_can_be_the_best(make_run: MakeRun) -> None:
    runs = [make_run("farthest", seed, {20: 20.0}) for seed in range(3)]
    text = markdown(summarise("room", PRESETS["fisherrf"], [*runs, make_run("fisher", 0, {20: 25.0})]))
    assert "| fisher | 25.00 |" in text
    assert "| farthest | **20.00 ± 0.00** |" in text


def test_runs_that_ended_early_count_where_they_got_to_and_are_named(make_run: MakeRun) -> None:
    runs = [
        make_run("nearest", 0, {10: 15.0, 20: 20.0}),
        make_run("nearest", 1, {10: 17.0, 12: 18.0}).model_copy(update={"stop": "Nothing was in reach."}),
    ]
    summary = summarise("room", PRESETS["nearest5"], runs)
    counts = {row.visited: row.psnr_db.count for row in summary.rows}
    assert counts == {10: 2, 12: 1, 20: 1}
    (note,) = summary.notes
    assert note == "nearest, seed 1, ended at 12 views: Nothing was in reach."


def test_views_that_were_not_registered_are_named(make_run: MakeRun) -> None:
    run = make_run("nearest", 0, {20: 20.0})
    last = run.evaluations[-1].model_copy(update={"registered": 17})
    summary = summarise("room", PRESETS["paper"], [run.model_copy(update={"evaluations": (last,)})])
    assert any("3 of 20" in note for note in summary.notes)
