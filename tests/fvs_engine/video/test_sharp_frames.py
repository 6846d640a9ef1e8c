from collections.abc import Sequence

import pytest

from fvs_engine.video.sharp_frames import choose_sharp_frames


def _chosen(times: Sequence[float], sharpness: Sequence[float], every_s: float = 1.0) -> list[float]:
    frames = zip(times, sharpness, strict=True)
    return [chosen.time_s for chosen in choose_sharp_frames(frames, every_s, lambda frame: frame)]


def test_the_sharpest_frame_around_each_moment_is_chosen() -> None:
    times = [number / 10 for number in range(22)]
    sharpness = [1.0] * 22
    for number, value in {2: 1.5, 5: 9.0, 8: 1.2, 11: 1.4, 15: 9.0, 20: 1.1}.items():
        sharpness[number] = value
    assert _chosen(times, sharpness) == [0.2, 1.1, 2.0]


def test_where_all_are_blurred_the_next_sharp_frame_is_chosen_else_the_best() -> None:
    times = [number / 10 for number in range(18)]
    sharpness = [0.1, 0.2, 0.15, 0.1, 0.1, 0.6, 0.9] + [0.9] + [0.05] * 3 + [0.07] + [0.01] * 6
    assert _chosen(times, sharpness) == [0.5, 1.1]


def test_only_some_frames_of_a_fast_video_are_measured() -> None:
    measured = []

    def measure(frame: int) -> float:
        measured.append(frame)
        return 1.0

    list(choose_sharp_frames(((number / 240, number) for number in range(2400)), 1.0, measure))
    assert len(measured) == pytest.approx(10 * 12, rel=0.1)


def test_a_variable_rate_leaves_moments_without_frames_out() -> None:
    assert _chosen([0.0, 0.3, 5.1, 5.2, 9.9], [1.0, 1.0, 1.0, 2.0, 1.0]) == [0.0, 5.2, 9.9]
    assert _chosen([], []) == []
