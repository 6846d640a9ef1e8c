"""The simulated vehicle: limits, battery, wind, and where a receiver's errors take it."""

import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.lab.simulate.vehicle import Goal, GpsErrors, Limits, Vehicle, Wind

EXACT = GpsErrors(noise_m=0.0, bias_m=0.0)


def flown(vehicle: Vehicle, goal: Goal, seconds: float, step_s: float = 0.05) -> np.ndarray:
    """Its positions [n, 3] on the way."""
    found = []
    for _ in range(round(seconds / step_s)):
        vehicle.step(step_s, goal)
        found.append(vehicle.position.copy())
    return np.array(found)


def goal(x: float, y: float, z: float, yaw_deg: float = 0.0) -> Goal:
    return Goal(np.array([x, y, z]), yaw_deg, speed_m_s=5.0)


def test_it_arrives_within_its_limits() -> None:
    vehicle = Vehicle(gps=EXACT)
    path = flown(vehicle, goal(40.0, 30.0, 12.0), 25.0)
    velocity = np.diff(path, axis=0) / 0.05
    assert vehicle.position == pytest.approx([40.0, 30.0, 12.0], abs=0.05)
    assert np.hypot(*velocity[:, :2].T).max() == pytest.approx(5.0, rel=0.01)  # the goal's speed
    assert velocity[:, 2].max() <= 3.0 + 1e-6
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() <= 3.0 * 0.05 + 1e-6


def test_it_descends_as_slowly_as_its_goal_says() -> None:
    vehicle = Vehicle(gps=EXACT, position=np.array([0.0, 0.0, 10.0]))
    slow = Goal(np.zeros(3), 0.0, speed_m_s=5.0, climb_m_s=0.5)
    path = flown(vehicle, slow, 10.0)
    assert np.diff(path[:, 2]).min() == pytest.approx(-0.5 * 0.05, rel=0.01)
    assert vehicle.position[2] == pytest.approx(5.0, abs=0.2)


def test_it_turns_the_short_way_and_the_gimbal_stops_at_its_end() -> None:
    vehicle = Vehicle(gps=EXACT, yaw_deg=350.0, limits=Limits(yaw_rate_deg_s=10.0, gimbal_rate_deg_s=20.0))
    flown(vehicle, goal(0, 0, 5, yaw_deg=20.0), 1.0)
    assert vehicle.yaw_deg == pytest.approx(0.0, abs=1e-6) or vehicle.yaw_deg == pytest.approx(360.0)
    vehicle.point(1.0, -120.0)
    assert vehicle.pitch_deg == pytest.approx(-20.0)
    flown(vehicle, goal(0, 0, 5, yaw_deg=20.0), 9.0)
    assert vehicle.yaw_deg == pytest.approx(20.0)
    vehicle.point(9.0, -120.0)
    assert vehicle.pitch_deg == -90.0


def test_a_biased_receiver_takes_it_elsewhere() -> None:
    off = []
    for seed in range(100):
        vehicle = Vehicle(gps=GpsErrors(noise_m=1.5, bias_m=2.0), seed=seed)
        flown(vehicle, goal(10.0, 0.0, 10.0), 12.0, step_s=0.25)
        assert vehicle.believed == pytest.approx([10.0, 0.0, 10.0], abs=0.6)
        off.append(vehicle.position[0] - 10.0)
    assert np.std(off) == pytest.approx(2.0, rel=0.25)
    vehicle = Vehicle(gps=GpsErrors(noise_m=1.5, bias_m=0.0))
    fixes = np.array([vehicle.fix() for _ in range(2_000)])
    assert fixes.std(axis=0) == pytest.approx([1.5, 1.5, 2.25], rel=0.1)


def test_gusts_move_it_and_it_comes_back() -> None:
    vehicle = Vehicle(gps=EXACT, wind=Wind(gusts_m_s=4.0))
    flown(vehicle, goal(0.0, 0.0, 10.0), 10.0)
    path = flown(vehicle, goal(0.0, 0.0, 10.0), 120.0)
    assert 0.1 < np.linalg.norm(path - [0.0, 0.0, 10.0], axis=1).max() < 5.0


def test_a_hover_is_no_way() -> None:
    vehicle = Vehicle(gps=GpsErrors(1.5, 0.1), wind=Wind((3.0, 1.0), 1.0))
    flown(vehicle, goal(0.0, 30.0, 10.0), 20.0)
    there_m = vehicle.flown_m
    assert there_m == pytest.approx(np.hypot(30.0, 10.0), rel=0.15)
    flown(vehicle, goal(0.0, 30.0, 10.0), 300.0)
    assert vehicle.flown_m - there_m < 10.0


def test_the_battery_lasts_as_long_as_it_is_said_to_and_wind_costs() -> None:
    still, windy = (Vehicle(gps=EXACT, endurance_s=100.0, wind=wind) for wind in (Wind(), Wind((8.0, 0.0))))
    for vehicle in (still, windy):
        flown(vehicle, goal(0.0, 0.0, 0.01), 50.0)
    assert still.battery == pytest.approx(0.5, abs=0.01)
    assert windy.battery == pytest.approx(0.25, abs=0.01)
    flown(still, goal(0.0, 0.0, 0.01), 60.0)
    assert still.battery == 0.0


def test_the_same_seed_flies_the_same_way() -> None:
    paths = [
        flown(Vehicle(wind=Wind((1.0, 2.0), 2.0), seed=seed), goal(20.0, 5.0, 8.0), 10.0)
        for seed in (1, 1, 2)
    ]
    assert np.array_equal(paths[0], paths[1])
    assert not np.allclose(paths[0], paths[2])


def test_a_vehicle_that_cannot_move_is_refused() -> None:
    with pytest.raises(InvalidInputError):
        Limits(speed_m_s=0.0)
    with pytest.raises(InvalidInputError):
        Vehicle(endurance_s=0.0)
