"""Units by suffix: every suffix against its factor, and whole tables against conversions by hand."""

import math
import pickle

import pytest

from swarm import scenario
from swarm.units import ARCSEC, UNITS, si, si_name, split_unit, written_unit

FACTORS = {
    "arcsec": math.pi / 648000,
    "arcmin": math.pi / 10800,
    "deg": math.pi / 180,
    "deg_s": math.pi / 180,
    "deg_s2": math.pi / 180,
    "deg_per_rad": math.pi / 180,
    "ppm": 1e-6,
    "percent": 1e-2,
    "um": 1e-6,
    "mm": 1e-3,
    "cm": 1e-2,
    "km": 1e3,
    "ns": 1e-9,
    "us": 1e-6,
    "ms": 1e-3,
}
"""Every suffix that is not an SI unit; the others keep their values."""


@pytest.mark.parametrize("suffix", UNITS)
def test_every_suffix_converts_by_its_factor_and_names_an_si_unit(suffix):
    unit = UNITS[suffix]
    factor = 1.0 if unit.convert is None else unit.convert(1.0)
    assert factor == pytest.approx(FACTORS.get(suffix, 1.0), rel=1e-15)
    assert (unit.convert is None) == (suffix not in FACTORS)
    # The name in SI units is one that stays as it is.
    assert si_name(si_name(f"x_{suffix}")) == si_name(f"x_{suffix}") == (f"x_{unit.si}" if unit.si else "x")


@pytest.mark.parametrize("suffix", UNITS)
def test_a_name_is_split_at_its_longest_unit(suffix):
    assert split_unit(f"some_rate_{suffix}") == ("some_rate", UNITS[suffix])
    assert written_unit(f"some_rate_{suffix}") == UNITS[suffix].written


@pytest.mark.parametrize("name", ["seed", "m", "items", "glasses", "rotor_correlation"])
def test_a_name_without_unit_stays(name):
    assert split_unit(name) == (name, None)
    assert (written_unit(name), si_name(name)) == ("", name)


def test_a_table_in_si_units():
    station = si(scenario.Lighthouse(angle_noise_arcsec=8.8, sync_jitter_ns=3.0, mounting_error_mm=0.5))
    assert station.angle_noise_rad == 8.8 * ARCSEC
    assert station.field_rad == math.radians(120.0)
    assert station.sync_jitter_s == 3.0 * 1e-9
    assert station.mounting_error_m == 5e-4
    assert (station.rate_hz, station.mounting_seed, station.model) == (60.0, None, "lighthouse")
    assert si(scenario.Actuation(thrust_error_percent=7.0)).thrust_error == 7.0 / 100
    assert si(scenario.Orbit(altitude_km=500.0)).altitude_m == 500e3


def test_tables_and_lists_within_a_table_are_converted():
    tumble = si(scenario.Tumble(kind="tumble", angular_rate_deg_s=(180.0, 0.0, 90.0)))
    assert tumble.angular_rate_rad_s == (math.pi, 0.0, math.pi / 2)
    assert tumble.attitude.spin_rad_s == 0.0
    figures = (scenario.Figure(shape="ring", radius_m=1.0, tilt_deg=90.0),)
    assert si(scenario.Formation(kind="formation", figures=figures)).figures[0].tilt_rad == math.pi / 2
    assert si(scenario.Ccd(target="other")).believed_noise_m is None


def test_a_table_in_si_units_is_frozen_travels_and_tells_what_it_has():
    fan = si(scenario.Fan(tilt_rad=0.1))
    with pytest.raises(AttributeError, match=r"Fan has no 'tilt_deg' in SI units; it has phase_rad, tilt_rad, curve"):
        _ = fan.tilt_deg
    with pytest.raises(AttributeError, match="frozen"):
        fan.tilt_rad = 0.2
    assert pickle.loads(pickle.dumps(fan)).tilt_rad == 0.1
    assert "gibbous_phase_rad" in dir(fan)
