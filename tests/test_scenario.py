"""The scenario file: every mistake named, every default written out, units converted once."""

import json
import math
import tomllib
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from estimators.filter import error_state
from swarm import scenario
from swarm.assets import find_model, scenarios
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.scenario import Scenario, for_replay, load, to_toml
from swarm.scenario.mistakes import tables_of
from swarm.scenario.motions import Course, paths
from swarm.scenario.table import Table
from swarm.scenario.text import changed, toml_value
from swarm.units import si, written_unit
from swarm.world.motion.paths import grouped

ROOT = Path(__file__).parent.parent
DIMENSIONLESS = {
    "rotor_correlation",
    "curve",
    "gibbous_magnitude",
    "ogee_magnitude",
    "gate_probability",
    "integrity_risk",
    "share",
    "min",
    "max",
}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "mine.toml"


def mistakes(file: Path, text: str, *overrides: str, seed: int | None = None) -> list[str]:
    file.write_text(text)
    with pytest.raises(SwarmError) as raised:
        load(file, overrides, seed)
    return str(raised.value).splitlines()


def fields(table: type[Table] = Scenario) -> Iterator[tuple[type[Table], str, FieldInfo]]:
    """Every field of every table below `table`."""
    for key, field in table.model_fields.items():
        yield table, key, field
        for inner in tables_of(field.annotation):
            yield from fields(inner)


@pytest.mark.parametrize("name", sorted(scenarios()))
def test_shipped_scenarios_load_and_say_what_they_are(name: str) -> None:
    shipped = load(name)
    assert shipped.name == name
    assert shipped.description
    assert scenarios()[name].read_text().startswith("#")


@pytest.mark.parametrize("name", sorted(scenarios()))
def test_the_written_scenario_loads_again_to_an_equal_one(name: str, tmp_path: Path) -> None:
    where = "station[0].plane_1" if load(name).station else "lighthouse.fan_x"
    flown = load(name, [f"{where}.phase_rad=0.03"], seed=99)
    copy = tmp_path / "scenario.toml"
    copy.write_text(to_toml(flown, ["lighthouse-swarm 1.2.3"]))
    assert load(copy) == flown
    assert copy.read_text().startswith("# lighthouse-swarm 1.2.3\n")


def test_written_text_is_toml_whatever_stands_in_it(file: Path, tmp_path: Path) -> None:
    awkward = 'quote " backslash \\ newline \n tab \t delete \x7f umlaut ü, # no comment'
    model = tmp_path / "my craft" / "thing.xml"
    model.parent.mkdir()
    model.write_text("<mujoco/>")
    file.write_text(
        "[swarm]\ncount = 1\nmodel = 'my craft/thing.xml'\n[lighthouse.fan_x]\ncurve = 1e-5\n[[craft]]\nname = 'x.1'"
    )
    before = load(file)
    odd = before.model_copy(update={"description": awkward})
    # The oracle is Python's own TOML parser against pydantic's dump: neither is ours.
    assert tomllib.loads(to_toml(odd)) == odd.model_dump(exclude_none=True, mode="json")
    elsewhere = tmp_path / "run" / "scenario.toml"
    elsewhere.parent.mkdir()
    elsewhere.write_text(to_toml(before))
    assert load(elsewhere) == before
    assert before.swarm.model == str(model)


def test_every_default_is_written_and_what_is_unset_says_so() -> None:
    text = to_toml(load("formation"))
    written = tomllib.loads(text)
    assert written["lighthouse"]["rotor_correlation"] == 0.8717
    assert written["swarm"]["motion"]["attitude"]["spin_deg_s"] == 0.0
    assert "# angle_noise_arcsec: that of the lighthouse." in text


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            "[lighthouse]\nangle_noise_deg = 0.1",
            "lighthouse.angle_noise_deg = 0.1: unknown key; did you mean 'angle_noise_arcsec' (in arcsec)?",
        ),
        (
            "[lighthouse]\nrange_min_mm = 3",
            "lighthouse.range_min_mm = 3: unknown key; did you mean 'range_min_m' (in m)?",
        ),
        (
            "[lighthouse]\nangle_noise = 3",
            "lighthouse.angle_noise = 3: unknown key; did you mean 'angle_noise_arcsec' (in arcsec)?",
        ),
        ("[lighthouze]\n", "lighthouze: unknown key; did you mean 'lighthouse'?"),
        ("[navigation.quiet]\nmodel = 3", "navigation.quiet.model = 3: unknown key; did you mean 'models'?"),
        ("count = 3", "count = 3: unknown key here; it belongs to [swarm]"),
        ("sede = 3", "sede = 3: unknown key; did you mean 'seed'?"),
        (
            "[navigation]\nacceleration = 1",
            "navigation.acceleration = 1: unknown key; did you mean 'acceleration_noise_m_s2' (in m/s²)?",
        ),
        (
            '[lighthouse]\nrange_max_m = "20 m"',
            'lighthouse.range_max_m = "20 m": expected a number in m, not a string; write 20',
        ),
        (
            '[lighthouse]\nrange_max_m = "80 cm"',
            'lighthouse.range_max_m = "80 cm": expected a number in m, not a string; convert it to m',
        ),
        ("[lighthouse]\nrange_min_m = -1", "lighthouse.range_min_m = -1: must be at least 0 m"),
        (
            "[lighthouse]\nrange_max_m = 0.2",
            "lighthouse.range_min_m: range_min_m (0.3 m) must be below range_max_m (0.2 m)",
        ),
        ("[lighthouse]\nfield_deg = inf", "lighthouse.field_deg = inf: must be a finite number in deg"),
        ("duration_s = 0", "duration_s = 0: must be at least 0.001 s"),
        ("duration_s = true", "duration_s = true: expected a number in s, not true or false"),
        ("seed = -1", "seed = -1: must be at least 0"),
        ("seed = 1.5", "seed = 1.5: expected a whole number, not a decimal"),
        ("[physics]\nsteps_per_period = 7", "physics.steps_per_period = 7: must be a multiple of 2"),
        (
            '[swarm]\nfeedback = "trth"',
            "swarm.feedback = \"trth\": must be 'truth' or 'estimate'; did you mean 'truth'?",
        ),
        ('[swarm]\nmodel = "mockpu"', "swarm.model = \"mockpu\": no model 'mockpu'; did you mean 'mockup'?"),
        (
            '[lighthouse]\nmodel = "lighthose"',
            "lighthouse.model = \"lighthose\": no model 'lighthose'; did you mean 'lighthouse'?",
        ),
        ('[swarm]\nmotion = "hold"', 'swarm.motion = "hold": expected a table, such as { kind = "hold" }'),
        ('[swarm]\nmotion = {kind = "rign"}', "did you mean 'ring'?"),
        ("[swarm]\nmotion = {}", "swarm.motion.kind: missing: one of 'hold', 'ring', 'waypoints'"),
        ('[swarm]\nmotion = {kind = "ring"}', "swarm.motion.radius_m: missing (in m): Radius of the circle."),
        (
            '[swarm]\nmotion = {kind = "ring", radius_m = 1, position_m = [0, 0, 1]}',
            "unknown key of kind 'ring'; it belongs to kind 'hold' or",
        ),
        (
            '[swarm]\nmotion = {kind = "hold", position_m = [0, 0]}',
            "swarm.motion.position_m = [0, 0]: expected a list of three numbers in m",
        ),
        (
            '[swarm]\nmotion = {kind = "hold", position_m = [0, 0, "2"]}',
            'swarm.motion.position_m[2] = "2": expected a number in m, not a string; write 2',
        ),
        (
            '[[craft]]\nmotion = {kind = "approach", from_m = [0, 0, 1], to_m = [0, 0, 1], speed_m_s = 1}',
            "craft[0].motion.to_m = [0, 0, 1]: must differ from from_m, where the approach starts",
        ),
        (
            '[[craft]]\nmotion = {kind = "waypoints", points_m = [[0, 0, 1]], times_s = [0, 1]}',
            "craft[0].motion.times_s = [0, 1]: has 2 times for 1 points_m",
        ),
        (
            '[[craft]]\nmotion = {kind = "waypoints", points_m = [[0, 0, 1], [0, 0, 2]], times_s = [1, 1]}',
            "craft[0].motion.times_s = [1, 1]: must increase strictly: times_s[1] = 1.0 follows 1.0",
        ),
        (
            '[[craft]]\nmotion = {kind = "waypoints", points_m = [[0, 0, 1]], times_s = [-1]}',
            "craft[0].motion.times_s[0] = -1: must be at least 0 s",
        ),
        (
            '[[craft]]\nmotion = {kind = "waypoints", points_m = [[0, 0, 1]], times_s = [30]}',
            "times_s = [30]: the first time (30 s) must lie within the run, which ends at duration_s = 30 s",
        ),
        (
            '[[craft]]\nmotion = {kind = "waypoints", points_m = [], times_s = [1]}',
            "craft[0].motion.points_m = []: must not be empty",
        ),
        (
            '[swarm]\nmotion = {kind = "approach", from_m = [0, 0, 2], to_m = [0, 0, 1], speed_m_s = 1}',
            'swarm.count = 2: must be 0 or 1 where motion.kind = "approach"',
        ),
        ('[[craft]]\nname = "craft-0"', 'craft[0].name = "craft-0": another craft has this name'),
        ('[[craft]]\nname = "lighthouse"', 'craft[0].name = "lighthouse": is the name of the lighthouse itself'),
        ('[[craft]]\nname = "a/b"', 'craft[0].name = "a/b": must be letters, digits'),
        ("[craft]\nname = 'a'", "craft: expected a list of tables: begin each with [[craft]]"),
        (
            '[recording]\ndetail = ["craft-9"]',
            'recording.detail[0] = "craft-9": no craft has this name; did you mean \'craft-',
        ),
        ('[navigation]\ncalibration = "none.json"', 'navigation.calibration = "none.json": there is no file /'),
    ],
)
def test_a_mistake_is_named_with_file_key_value_and_what_is_right(file: Path, text: str, line: str) -> None:
    top, _, tables = text.partition("[") if not text.startswith("[") else ("", "", text[1:])
    swarm = "" if "[swarm]" in text else "\n[swarm]\ncount = 2\n"
    tables = f"[{tables}".replace("[swarm]", "[swarm]\ncount = 2") if tables else ""
    found = mistakes(file, f"{top}\n{tables}{swarm}")
    assert len(found) == 1, found
    assert found[0].startswith(f"{file}: ")
    assert line in found[0]


def test_all_mistakes_are_told_at_once_the_most_telling_first(file: Path) -> None:
    found = mistakes(file, 'duration_s = -1\nsede = 3\n[swarm]\ncount = "x"\nmotion = {kind = "ring", radius = 1}')
    assert [line.split(": ")[1] for line in found] == [
        "swarm.motion.radius = 1",  # and radius_m is not "missing" as well
        "sede = 3",
        'swarm.count = "x"',
        "duration_s = -1",
    ]


def test_no_craft_at_all(file: Path) -> None:
    assert "there is no craft at all: set swarm.count, or add a [[craft]] entry" in mistakes(file, "")[0]
    file.write_text("[[craft]]\n")
    assert load(file).craft_names == ("craft-0",)


@pytest.mark.parametrize(
    ("content", "where"),
    [
        (b"duration_s = \n", "mine.toml, line 1, column 14: not TOML: invalid value"),
        (b"[swarm\n", "mine.toml, line 1, column 7: not TOML: expected ']'"),
        (b"[swarm", "not TOML: expected ']'"),
        (b"a = 1\na = 2\n", "mine.toml, line 2, column 6: not TOML: cannot overwrite a value"),
        (b"name = '\xff'", "mine.toml, byte 8: not UTF-8 text"),
    ],
)
def test_what_is_not_toml_says_where(file: Path, content: bytes, where: str) -> None:
    file.write_bytes(content)
    with pytest.raises(SwarmError) as raised:
        load(file)
    assert where in str(raised.value)


def test_a_scenario_that_does_not_exist_names_the_nearest() -> None:
    with pytest.raises(SwarmError, match="did you mean 'formation'"):
        load("formatoin")


def test_overrides_take_toml_values_and_bare_words() -> None:
    changed = load(
        "rendezvous",
        [
            "craft[0].motion.from_m=[0, 0, 6.5]",
            "craft.1.name=bow",
            "lighthouse.fan_y={tilt_rad = 0.01}",
            "navigation.motion_compensation=false",
            "description=not quoted",
        ],
        seed=4,
    )
    approach = changed.craft[0].motion
    assert isinstance(approach, scenario.Approach)
    assert approach.from_m == (0.0, 0.0, 6.5)
    assert changed.craft_names == ("chaser", "bow", "starboard", "keel")
    assert changed.lighthouse.fan_y.tilt_rad == 0.01
    assert changed.navigation.motion_compensation is False
    assert changed.description == "not quoted"
    assert changed.seed == 4
    assert load("rendezvous").craft[0] != changed.craft[0]


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("swarm.cuont=3", "--set: swarm.cuont = 3: unknown key; did you mean 'count'?"),
        ("swarm.count=-3", "--set: swarm.count = -3: must be at least 0"),
        ("lighthouse.range_max_m=0.1", "--set: lighthouse.range_max_m = 0.1: range_min_m (0.3 m) must be below"),
        ("swarm.count", "--set: 'swarm.count' is not key=value"),
        ("=3", "--set: '=3' is not key=value"),
        ("swarm..count=3", "is not key=value"),
        ("swarm.count=[3", "--set: swarm.count=[3: the value is not TOML"),
        ("duration_s.x=3", "--set: duration_s.x=3: duration_s is not a table"),
        ("craft[0].name=a", "--set: craft[0].name=a: craft[0] does not exist: craft is not a list"),
    ],
)
def test_mistakes_in_overrides_name_the_option(override: str, line: str) -> None:
    with pytest.raises(SwarmError) as raised:
        load("formation", [override])
    assert line in str(raised.value)


def test_another_kind_of_motion_is_one_mistake() -> None:
    with pytest.raises(SwarmError) as raised:
        load("formation", ["swarm.motion.kind=waypoints"])
    assert str(raised.value) == (
        '--set: swarm.motion.kind = "waypoints": this kind needs points_m and times_s and has no centre_m or radius_m '
        "or rate_deg_s or tilt_deg: set the whole table, "
        """--set 'swarm.motion={kind = "waypoints", points_m = ..., times_s = ...}'"""
    )


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    (tmp_path / "windows.toml").write_bytes(b"\xef\xbb\xbfduration_s = 2\n[swarm]\ncount = 1\n")
    assert load(tmp_path / "windows.toml").duration_s == 2


def test_overrides_of_single_craft_say_which() -> None:
    for override, line in (
        ("craft[9].name=a", "craft[9] does not exist: craft has 4 entries, counted from 0"),
        ("craft.name=a", "craft is not a table; say which, as in craft[0].name"),
        ("craft.starboard.model=a", "craft is not a table; say which, as in craft[2].model"),
    ):
        with pytest.raises(SwarmError) as raised:
            load("rendezvous", [override])
        assert line in str(raised.value)
    with pytest.raises(SwarmError, match=r"^--seed: seed = -1: must be at least 0: a seed is not negative$"):
        load("rendezvous", seed=-1)


def test_relative_models_begin_at_the_file_or_for_set_at_the_working_directory(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    for model in (tmp_path / "beside.xml", here / "typed.xml"):
        model.write_text("<mujoco/>")
    monkeypatch.chdir(here)
    file.write_text('[swarm]\ncount = 1\nmodel = "beside.xml"')
    assert load(file).swarm.model == str(tmp_path / "beside.xml")
    assert load(file, ["swarm.model=typed.xml"]).swarm.model == str(here / "typed.xml")


def test_craft_are_numbered_swarm_first(file: Path) -> None:
    file.write_text(
        '[swarm]\ncount = 2\n[[craft]]\n[[craft]]\nname = "odd"\nmodel = "cubesat6u"\nfeedback = "estimate"'
    )
    craft = scenario.craft(load(file))
    assert [c.name for c in craft] == ["craft-0", "craft-1", "craft-2", "odd"]
    assert [(c.index, c.count) for c in craft] == [(0, 2), (1, 2), (0, 1), (0, 1)]
    assert [c.model.stem for c in craft] == ["mockup", "mockup", "mockup", "cubesat6u"]
    assert builders.steers_by_estimate(load(file)).tolist() == [False, False, False, True]


def test_a_replay_takes_only_what_it_uses() -> None:
    settings = scenario.for_replay(Path("x/walk no 1.rec.gz"), ["navigation.coast_limit_s=1"], seed=3)
    assert (settings.name, settings.seed, settings.navigation.coast_limit_s) == ("walk-no-1", 3, 1.0)
    with pytest.raises(SwarmError, match=r"a replay takes only navigation"):
        scenario.for_replay(Path("walk.rec"), ["swarm.count=3"])


def test_every_key_has_a_meaning_a_unit_and_limits() -> None:
    for table, key, field in fields():
        where = f"{table.__name__}.{key}"
        assert field.description, where
        numbers = [a for a in (field.annotation, *get_args(field.annotation)) if a in (int, float)]
        if float in numbers:
            assert written_unit(key) or key in DIMENSIONLESS or key.endswith("_probability"), where
        if numbers:
            kinds = {type(limit) for limit in field.metadata}
            assert kinds & {Ge, Gt}, where
            assert kinds & {Le, Lt}, where


def test_limits_are_written_as_they_are_enforced(file: Path) -> None:
    """A value beyond the limit that the reference states is refused, the limit itself is taken."""
    for key, field in scenario.Lighthouse.model_fields.items():
        for limit in field.metadata:
            if not isinstance(limit, Ge | Le):
                continue
            bound = float(str(limit.ge if isinstance(limit, Ge) else limit.le))
            beyond = bound - 1e-6 if isinstance(limit, Ge) else bound + 1e-3
            if "int" in str(field.annotation):
                bound, beyond = int(bound), int(bound) + (-1 if isinstance(limit, Ge) else 1)
            near = "range_max_m=1000" if key == "range_min_m" else "range_min_m=0"
            base = ["swarm.count=1", f"lighthouse.{near}"]
            if not (key == "range_min_m" and isinstance(limit, Le)):
                load("formation", [*base, f"lighthouse.{key}={bound}"])
            with pytest.raises(SwarmError, match=r"must be at (least|most)"):
                load("formation", [*base, f"lighthouse.{key}={beyond}"])


def test_settings_are_si() -> None:
    """Against numbers worked out by hand."""
    settings = load(
        "formation",
        [
            "lighthouse.sync_jitter_ns=3",
            "lighthouse.mounting_error_mm=0.5",
            "lighthouse.fan_y.gibbous_magnitude=0.01",
            "lighthouse.rate_hz=50",
        ],
    )
    station = si(settings.lighthouse)
    assert station.angle_noise_rad == pytest.approx(4.266e-5, rel=1e-4)  # 8.8", as source 1's note has it
    assert station.field_rad == pytest.approx(2 * math.pi / 3, rel=1e-15)
    assert station.incidence_max_rad == pytest.approx(1.3962634, rel=1e-7)
    assert (station.sync_jitter_s, station.tick_s) == pytest.approx((3e-9, 2e-8), rel=1e-15)
    assert (station.mounting_error_m, station.photodiode_diameter_m) == pytest.approx((5e-4, 3e-3), rel=1e-15)
    assert station.fan_y.gibbous_magnitude == 0.01
    craft = builders.navigation(settings)
    assert craft.frame_s == 0.02
    w = 2 * math.pi * 50
    shared = 0.8717 * station.angle_noise_rad**2 + (w * 2e-8) ** 2 / 12 + (w * 3e-9) ** 2
    own = (1 - 0.8717) * station.angle_noise_rad**2 + (w * 2e-8) ** 2 / 12
    assert craft.angle_noise_rad == pytest.approx(math.sqrt(shared + own), rel=1e-12)
    assert craft.rotor_correlation == pytest.approx(shared / (shared + own), rel=1e-12)


def test_a_craft_without_noise_assumes_that_of_its_ticks() -> None:
    settings = load("formation", ["lighthouse.angle_noise_arcsec=0"])
    # Uniform rounding of two instants to 20 ns, at 60 turns per second: 2 pi 60 sqrt(2 / 12) 20e-9 rad.
    assert builders.navigation(settings).angle_noise_rad == pytest.approx(3.078e-6, rel=1e-3)


def test_process_noise_defaults_are_the_filters() -> None:
    made = builders.navigation(load("formation"))
    assert made.acceleration_noise_m_s2 == error_state.DEFAULT_ACCELERATION_NOISE_M_S2
    # The scenario has it in degrees: a rounding error of the conversion.
    assert made.angular_acceleration_noise_rad_s2 == pytest.approx(
        error_state.DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2, rel=1e-15
    )


def course_of(settings: Scenario, craft: int = 0) -> Course:
    made = scenario.craft(settings)
    return made[craft].table.motion.course(builders.craft.places(settings, made)[craft])


def test_drift_is_the_filters_own_model_unless_told() -> None:
    believed = builders.navigation(load("drift", ["navigation.acceleration_noise_m_s2=0.3"]))
    own = course_of(load("drift", ["navigation.acceleration_noise_m_s2=0.3"])).push
    assert own[0] == believed.acceleration_noise_m_s2 == 0.3
    assert own[1] == believed.angular_acceleration_noise_rad_s2
    told = course_of(load("drift", ["swarm.motion.angular_acceleration_deg_s2=90"])).push
    assert told[1] == pytest.approx(math.pi / 2, rel=1e-15)


def test_every_motion_becomes_its_course(file: Path) -> None:
    kinds = {
        "hold": "position_m = [1, 2, 3], spacing_m = 2",
        "ring": "centre_m = [1, 2, 3], radius_m = 2, rate_deg_s = 180, tilt_deg = 90",
        "waypoints": "points_m = [[1, 2, 3], [4, 5, 6]], times_s = [1, 2]",
        "approach": "from_m = [1, 2, 3], to_m = [4, 5, 6], speed_m_s = 2, start_s = 3",
        "tumble": "position_m = [1, 2, 3], velocity_m_s = [4, 5, 6], angular_rate_deg_s = [180, 0, 90]",
        "drift": "position_m = [1, 2, 3], velocity_m_s = [4, 5, 6]",
    }
    turned = "attitude = { facing = false, roll_deg = 180, pitch_deg = 90, yaw_deg = 45, spin_deg_s = 360 }"
    entries = (f'[[craft]]\nmotion = {{ kind = "{k}", {rest}, {turned} }}\n' for k, rest in kinds.items())
    file.write_text("".join(entries))
    settings = load(file)
    made = {kind: course_of(settings, i) for i, kind in enumerate(kinds)}
    one, four = (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)
    noise = settings.navigation
    expected: dict[str, paths.Path] = {
        "hold": paths.line(one, (0.0, 0.0, 0.0)),
        "ring": paths.Circle(one, 2.0, math.pi, math.pi / 2, 0.0),
        "waypoints": paths.smooth_through((one, four), (1.0, 2.0)),
        "approach": paths.corridor(one, four, 3.0, 2.0),
        "tumble": paths.line(one, four),
        "drift": paths.line(one, four),
    }
    for kind, course in made.items():
        assert (course.facing, course.spin_rad_s) == (False, 2 * math.pi)
        assert course.turn_rad == (math.pi / 4, math.pi / 2, math.pi)
        assert course.free == (kind in ("tumble", "drift"))
        (_, own), (_, wanted) = grouped([course.path])[0], grouped([expected[kind]])[0]
        for time_s in (0.0, 1.2, 3.4, 9.0):
            assert np.array_equal(own.at(time_s), wanted.at(time_s)), kind
    assert made["tumble"].rate_rad_s == (math.pi, 0.0, math.pi / 2)
    assert made["drift"].push == (
        noise.acceleration_noise_m_s2,
        math.radians(noise.angular_acceleration_noise_deg_s2),
    )


@pytest.mark.parametrize(
    ("override", "instead"),
    [
        ("swarm.model=cubesat6u", "craft[0].model, and so on,"),
        ("swarm.motion.kind=hold", "craft[0].motion.kind, and so on,"),
        ("swarm={count=0, feedback='truth'}", "craft[0].model, and so on,"),
    ],
)
def test_a_change_of_an_empty_swarm_is_refused(override: str, instead: str) -> None:
    with pytest.raises(SwarmError) as raised:
        load("static", [override])
    assert f": has no effect, because swarm.count = 0; change {instead} instead" in str(raised.value)
    assert load("static", [override, "swarm.count=1"]).swarm.count == 1


def test_changes_may_be_a_mapping_but_not_one_string() -> None:
    motion = {"kind": "hold", "position_m": (0.0, 0.0, 4.0)}
    changed = load("static", {"duration_s": 1.5, "craft[0].motion": motion, "craft[1].model": find_model("cubesat6u")})
    assert changed == load(
        "static",
        [
            "duration_s=1.5",
            "craft[0].motion={kind='hold', position_m=[0.0, 0.0, 4.0]}",
            f"craft[1].model='{find_model('cubesat6u')}'",
        ],
    )
    with pytest.raises(SwarmError, match=r"^overrides: duration_s = -1: must be at least"):
        load("static", {"duration_s": -1})
    with pytest.raises(SwarmError, match=r"^overrides: 'seed=1' is one string: give a list, \['seed=1'\], or \{'seed'"):
        load("static", "seed=1")


@pytest.mark.parametrize(("kind", "meant"), [("dark", "lighthouse-dark"), ("restrat", "restart")])
def test_a_kind_of_which_a_word_is_given_is_proposed_and_none_is_listed_twice(kind: str, meant: str) -> None:
    with pytest.raises(SwarmError) as raised:
        load("static", [f"fault=[{{kind='{kind}', at_s=1}}]"])
    assert str(raised.value).endswith(f"; did you mean {meant!r}?")
    assert str(raised.value).count("'photodiode-dead'") == 1


@pytest.mark.parametrize(
    ("overrides", "where"),
    [
        (["swarm.motion.radius_m=0.05"], "scenario formation: swarm.motion.radius_m = 0.05: craft 'craft-"),
        (["swarm.motion={kind='hold', spacing_m=0.02}"], "swarm.motion.spacing_m = 0.02: "),
        (
            ["swarm.count=1", "swarm.motion={kind='hold', position_m=[0,0,0.01]}"],
            "swarm.motion.position_m = [0.0, 0.0, 0.01]: ",
        ),
    ],
)
def test_craft_inside_another_one_name_the_keys_to_change(overrides: list[str], where: str) -> None:
    with pytest.raises(SwarmError) as raised:
        Flight(load("formation", overrides))
    assert where in str(raised.value)
    assert "inside" in str(raised.value)


def test_a_motion_that_makes_no_sense_names_its_keys() -> None:
    with pytest.raises(
        SwarmError, match=r"scenario static: craft\[1\]\.motion\.position_m = \[0\.0, 1\.0, 0\.0\]: .*face"
    ):
        Flight(load("static", ["craft[1].motion.position_m=[0.0, 1.0, 0.0]"]))


def test_a_model_with_too_few_photodiodes_names_its_key(file: Path, tmp_path: Path) -> None:
    sites = "".join(f'<site name="photodiode{i}" pos="{i} 0 0"/>' for i in range(3))
    body = f'<body name="b"><geom size="0.1"/>{sites}</body>'
    (tmp_path / "few.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    file.write_text(
        '[swarm]\ncount = 1\n[[craft]]\nmodel = "few.xml"\nmotion = {kind = "hold", position_m = [1, 0, 3]}'
    )
    with pytest.raises(SwarmError) as raised:
        Flight(load(file))
    assert "craft[0].model = " in str(raised.value)
    assert "3 photodiodes" in str(raised.value)


def test_the_reference_and_the_schema_in_docs_are_up_to_date() -> None:
    stale = "stale: run `python -m swarm.scenario docs`"
    assert (ROOT / "docs" / "scenario.md").read_text(encoding="utf-8") == scenario.markdown_reference(), stale
    assert json.loads((ROOT / "docs" / "scenario.schema.json").read_text(encoding="utf-8")) == scenario.json_schema(), (
        stale
    )


def test_the_reference_names_every_key_and_its_example_loads(file: Path) -> None:
    page = scenario.markdown_reference()
    for key in set(chain.from_iterable((key,) for _, key, _ in fields())) - {
        "kind",
        "physics",
        "navigation",
        "recording",
    }:
        assert f"`{key}`" in page or f"[{key}]" in page, key
    file.write_text(page.split("```toml\n")[1].split("```")[0])
    assert len(load(file).craft_names) == 4


def test_a_scenario_made_in_python_is_checked_too() -> None:
    with pytest.raises(SwarmError, match="there is no craft at all"):
        Scenario()
    made = Scenario(swarm=scenario.Swarm(count=2))
    assert made.craft_names == ("craft-0", "craft-1")
    with pytest.raises(SwarmError, match="a scenario does not change"):
        made.seed = 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("lighthouse.tick_ns=1e-9", "must be at least 0.01 ns"),
        ("lighthouse.tick_ns=10000", "must be at most 5000 ns"),
        ("lighthouse.rate_hz=1000", "must be at most 300 Hz"),
        ("navigation.acceleration_noise_m_s2=1e-300", "must be at least 1e-09 m/s²"),
        ("lighthouse.angle_noise_arcsec=1e-300", "must be 0, or at least 1e-09"),
        ("swarm.scatter.position_m=5e-324", "must be 0, or at least 1e-09"),
    ],
)
def test_a_number_that_would_destroy_the_flight_is_refused(change: str, message: str) -> None:
    with pytest.raises(SwarmError) as caught:
        load("static", [change])
    assert message in str(caught.value)


def test_no_number_of_a_scenario_is_bounded_by_nothing_but_zero() -> None:
    """A size above 0 has a least one too: 1e-300 passes any check against zero, and overflows when it is squared."""
    waiting: list[type[Table]] = [Scenario]
    loose = set()
    while waiting:
        table = waiting.pop()
        for key, field in table.model_fields.items():
            waiting += tables_of(field.annotation)
            if any(isinstance(limit, Gt) and limit.gt == 0 for limit in field.metadata):
                loose.add(key)
    assert loose == set()


def test_settings_that_are_not_the_usual_ones_are_told_as_set_takes_them():
    recording = Path("walk.rec.gz")
    usual = for_replay(recording)
    other = for_replay(recording, ["navigation.gate_probability=0.99", "navigation.integrity.residual_test=false"])
    assert list(changed(usual, usual)) == []
    told = {key: toml_value(value) for key, value in changed(usual, other)}
    assert told == {"navigation.gate_probability": "0.99", "navigation.integrity.residual_test": "false"}
    assert for_replay(recording, [f"{key}={value}" for key, value in told.items()]) == other
