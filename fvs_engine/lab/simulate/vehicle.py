"""A multicopter as a point mass: limits, battery, wind, and a GPS receiver that errs.

Positions are ENU in m, yaw is clockwise from north and pitch up, both in degrees. The vehicle steers by its
estimated position: it is where the errors of its receiver take it.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError

Array = NDArray[np.float64]

_RESPONSE_S = 1.0
"""Time constant of the position controller."""
_HELD_GUSTS = 0.15
"""Share of a gust's speed that moves the vehicle: its controller holds against the rest."""

_HELD_WIND_M_S = 20.0
"""An ArduCopter that leans by up to 30° holds against less."""

_STEP_M = 1.0
"""Shortest step that counts as flown."""


@dataclass(frozen=True)
class Limits:
    """What a vehicle and its gimbal can do."""

    speed_m_s: float = 8.0
    climb_m_s: float = 3.0
    acceleration_m_s2: float = 3.0
    yaw_rate_deg_s: float = 60.0
    gimbal_rate_deg_s: float = 45.0
    gimbal_lowest_deg: float = -90.0
    gimbal_highest_deg: float = 30.0

    def __post_init__(self) -> None:
        rates = (self.speed_m_s, self.climb_m_s, self.acceleration_m_s2, self.yaw_rate_deg_s)
        if min(*rates, self.gimbal_rate_deg_s) <= 0 or self.gimbal_lowest_deg >= self.gimbal_highest_deg:
            raise InvalidInputError("Speeds and rates of a vehicle are above zero, and its gimbal can move.")


@dataclass(frozen=True)
class Wind:
    """A mean wind, and gusts with a standard deviation that last some seconds."""

    mean_m_s: tuple[float, float] = (0.0, 0.0)
    """Towards east and north."""
    gusts_m_s: float = 0.0
    gust_s: float = 4.0


@dataclass(frozen=True)
class GpsErrors:
    """Standard deviations of a receiver's errors: noise of each fix, and a bias that drifts."""

    noise_m: float = 1.5
    bias_m: float = 0.5
    bias_s: float = 300.0
    """How long the bias takes to change."""


@dataclass
class Goal:
    """The goal of a vehicle: the position by its own estimate, and its yaw."""

    position: Array
    yaw_deg: float
    speed_m_s: float
    climb_m_s: float = math.inf
    """Largest vertical speed, up and down."""


@dataclass
class Vehicle:
    """A vehicle in the air or on the ground at height zero; ``step`` moves it.

    ``endurance_s`` is how long a full battery lasts in a hover; flying fast takes up to half as much more.
    """

    limits: Limits = field(default_factory=Limits)
    wind: Wind = field(default_factory=Wind)
    gps: GpsErrors = field(default_factory=GpsErrors)
    endurance_s: float = 1500.0
    seed: int = 0
    position: Array = field(default_factory=lambda: np.zeros(3))
    """The true position [3]."""
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    """Pitch of the gimbal."""
    battery: float = 1.0
    flown_m: float = 0.0
    """Length of its way, in steps of a metre: a hover adds nothing."""

    def __post_init__(self) -> None:
        if self.endurance_s <= 0:
            raise InvalidInputError("A battery lasts longer than no time.")
        self._random = np.random.default_rng(self.seed)
        self._gust = np.zeros(3)
        self._measured_at = self.position.copy()
        vertical = np.array([1.0, 1.0, 1.5])
        self._bias_m = self.gps.bias_m * vertical
        self._noise_m = self.gps.noise_m * vertical
        self._bias = self._random.normal(size=3) * self._bias_m

    @property
    def believed(self) -> Array:
        """The estimated position [3]: fixes are averaged, so that only the bias is left."""
        return self.position + self._bias

    def fix(self) -> Array:
        """A fix of the receiver [3], as a camera writes it into a photograph."""
        return self.believed + self._random.normal(size=3) * self._noise_m

    def step(self, seconds: float, goal: Goal | None) -> None:
        """Move towards ``goal`` for ``seconds``; None: stand on the ground."""
        drift = np.sqrt(2.0 * seconds / self.gps.bias_s)
        self._bias += (
            -self._bias * seconds / self.gps.bias_s + drift * self._random.normal(size=3) * self._bias_m
        )
        if goal is None:
            self.velocity[:] = 0.0
            return
        self._blow(seconds)
        limits = self.limits
        wanted = (goal.position - self.believed) / _RESPONSE_S
        wanted[:2] *= min(1.0, min(goal.speed_m_s, limits.speed_m_s) / max(np.hypot(*wanted[:2]), 1e-9))
        climb_m_s = min(goal.climb_m_s, limits.climb_m_s)
        wanted[2] = np.clip(wanted[2], -climb_m_s, climb_m_s)
        change = wanted - self.velocity
        most = limits.acceleration_m_s2 * seconds
        self.velocity += change * min(1.0, most / max(float(np.linalg.norm(change)), 1e-9))
        self.position += (self.velocity + _HELD_GUSTS * self._gust + self._carried_m_s) * seconds
        self.position[2] = max(self.position[2], 0.0)
        self._measure()
        turn = (goal.yaw_deg - self.yaw_deg + 180.0) % 360.0 - 180.0
        self.yaw_deg = (self.yaw_deg + _towards(turn, limits.yaw_rate_deg_s * seconds)) % 360.0
        through_air = self.velocity[:2] - np.array(self.wind.mean_m_s) - self._gust[:2]
        load = 1.0 + 0.5 * min(1.0, float(np.hypot(*through_air)) / limits.speed_m_s) ** 2
        self.battery = max(0.0, self.battery - load * seconds / self.endurance_s)

    def point(self, seconds: float, pitch_deg: float) -> None:
        """Turn the gimbal towards a pitch for ``seconds``."""
        limits = self.limits
        pitch = float(np.clip(pitch_deg, limits.gimbal_lowest_deg, limits.gimbal_highest_deg))
        self.pitch_deg += _towards(pitch - self.pitch_deg, limits.gimbal_rate_deg_s * seconds)

    @property
    def _carried_m_s(self) -> Array:
        """Velocity with which a wind carries it away that it cannot hold against."""
        wind = np.array([*self.wind.mean_m_s, 0.0])
        return wind * max(0.0, 1.0 - _HELD_WIND_M_S / max(float(np.linalg.norm(wind)), 1e-9))

    def _measure(self) -> None:
        """Add to the way what is a step away from where it was added last."""
        moved_m = float(np.linalg.norm(self.position - self._measured_at))
        if moved_m >= _STEP_M:
            self.flown_m += moved_m
            self._measured_at = self.position.copy()

    def _blow(self, seconds: float) -> None:
        """Change the gust: a random one that fades."""
        spread = self.wind.gusts_m_s * np.array([1.0, 1.0, 0.3])
        kick = np.sqrt(2.0 * seconds / self.wind.gust_s)
        self._gust += -self._gust * seconds / self.wind.gust_s + kick * self._random.normal(size=3) * spread


def _towards(difference: float, most: float) -> float:
    return float(np.clip(difference, -most, most))
