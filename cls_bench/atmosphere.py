"""Standard atmosphere up to 20 km, and what an airspeed means in it.

ISO 2533:1975, the same as ICAO Doc 7488/3: up to 11 km of geopotential altitude the temperature falls by 6.5 K/km from
288.15 K, then it stays at 216.65 K; the pressure follows from hydrostatics of a perfect gas. An altimeter set to
1013.25 hPa shows this altitude, whatever the weather.

Calibrated airspeed is what an airspeed indicator without error shows: by its definition the impact pressure is that of
this speed at sea level. Subsonic compressible flow (isentropic, γ = 1.4)::

    q_c = p_0 ((1 + 0.2 (V_c/a_0)²)^3.5 − 1) = p ((1 + 0.2 M²)^3.5 − 1),   V = M a,   ½ρV² = 0.7 p M²
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cls_bench.quantity import GRAVITY

Array = NDArray[np.float64]

TEMPERATURE, PRESSURE = 288.15, 101325.0
"""At sea level [K, Pa] (ISO 2533)."""

GAS_CONSTANT = 287.05287
"""R of air [J/(kg·K)] (ISO 2533)."""

RATIO_OF_HEATS = 1.4
"""γ of air (ISO 2533)."""

LAPSE, TROPOPAUSE = 0.0065, 11_000.0
"""Fall of temperature with altitude [K/m], and where it ends [m] (ISO 2533)."""

LOWEST, HIGHEST = -5_000.0, 20_000.0
"""Altitudes at which the two layers hold [m] (ISO 2533)."""

KNOT, FOOT = 1852.0 / 3600.0, 0.3048
"""[m/s], [m] (ISO 80000-3, international foot)."""


class Air(NamedTuple):
    """State of the air."""

    temperature: Array
    """[K]"""
    pressure: Array
    """[Pa]"""
    density: Array
    """[kg/m³]"""
    speed_of_sound: Array
    """[m/s]"""


def air(altitude: ArrayLike) -> Air:
    """The standard air at a geopotential altitude [m] from :data:`LOWEST` to :data:`HIGHEST`; ValueError elsewhere."""
    height = np.asarray(altitude, np.float64)
    if not np.all((height >= LOWEST) & (height <= HIGHEST)):
        raise ValueError(f"the altitude must lie from {LOWEST:g} to {HIGHEST:g} m")
    temperature = TEMPERATURE - LAPSE * np.minimum(height, TROPOPAUSE)
    below = PRESSURE * (temperature / TEMPERATURE) ** (GRAVITY / (LAPSE * GAS_CONSTANT))
    pressure = below * np.exp(-GRAVITY * np.maximum(height - TROPOPAUSE, 0.0) / (GAS_CONSTANT * temperature))
    density = pressure / (GAS_CONSTANT * temperature)
    return Air(temperature, pressure, density, np.sqrt(RATIO_OF_HEATS * GAS_CONSTANT * temperature))


_SOUND_AT_SEA_LEVEL = float(air(0.0).speed_of_sound)


class Airspeed(NamedTuple):
    """What a calibrated airspeed means at an altitude."""

    true: Array
    """[m/s]"""
    mach: Array
    dynamic_pressure: Array
    """½ρV² [Pa]"""


def of_calibrated(airspeed: ArrayLike, altitude: ArrayLike) -> Airspeed:
    """Of a calibrated airspeed [m/s] at an altitude [m]. ValueError where the flow is not subsonic."""
    speed, around = np.asarray(airspeed, np.float64), air(altitude)
    impact = PRESSURE * ((1.0 + 0.2 * (speed / _SOUND_AT_SEA_LEVEL) ** 2) ** 3.5 - 1.0)
    mach = np.sqrt(5.0 * ((impact / around.pressure + 1.0) ** (2.0 / 7.0) - 1.0))
    return _airspeed(mach, around)


def of_true(airspeed: ArrayLike, altitude: ArrayLike) -> Airspeed:
    """Of a true airspeed [m/s] at an altitude [m]. ValueError where the flow is not subsonic."""
    around = air(altitude)
    return _airspeed(np.asarray(airspeed, np.float64) / around.speed_of_sound, around)


def _airspeed(mach: Array, around: Air) -> Airspeed:
    if not np.all(mach < 1.0):
        raise ValueError(f"it is Mach {np.max(mach):.3g} there, and only subsonic flow is worked out")
    return Airspeed(mach * around.speed_of_sound, mach, 0.5 * RATIO_OF_HEATS * around.pressure * mach * mach)
