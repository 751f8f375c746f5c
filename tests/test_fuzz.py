"""Whatever a user writes becomes values, or one `SwarmError`: thousands of mutants of good texts.

    SWARM_FUZZ_MUTANTS=30000 python -m pytest tests/test_fuzz.py           thirty thousand mutants of each kind of text
    python tests/fuzz.py --scenarios 30000 --recordings 1000               the same scenarios built, recordings replayed

The second one runs under limits of memory and of processor time; here a few of each keep it in order.
"""

import json
from contextlib import nullcontext
from pathlib import Path

import made_recording
import pytest
from fuzz import faults, of_recordings, of_scenarios
from mutants import HOSTILE, mutant, tracebacks
from synthetic_recording import CHANNELS, FCAL, NORMALS, POINTS

from swarm.assets import scenarios, studies
from swarm.errors import SwarmError
from swarm.flight.recordings.station_calibration import read_calibration
from swarm.flight.recordings.tracked_object import read_config
from swarm.scenario import load, to_toml, validate
from swarm.scenario.load import parse_override
from swarm.studies.campaign.study import load_study, study_toml
from swarm.user_text import parse_json, parse_toml, user_path

OVERRIDES = [
    *("swarm.count=16", "craft[1].motion.from_m=[0, 0, 8]", "navigation.filter=compiled", "seed=3", "name=mine"),
    *("swarm.motion={kind='ring', radius_m=2.0}", "fault=[{kind='lighthouse-dark', at_s=1.0, for_s=5.0}]"),
    *("swarm.model=mockup", "navigation.calibration='calibration.toml'", "lighthouse.fan_x.tilt_rad=0.01"),
]
OURS = """
[fan_x]
phase_rad = 0.0586
tilt_rad = 0.0013
[fan_y]
curve = -0.0019
gibbous_phase_rad = 2.89
[photodiodes.craft-0]
point_m = [[0.07, 0.02, 0.03], [0.1, 0.0, 0.0]]
[photodiodes]
point_m = [[0.1, 0.0, 0.2]]
"""
WHOLE_STUDY = """
name = "x"
base = "static"
seeds = [1, 2]
samples = 3
sampling_seed = 1
telemetry = true
workers = 2
measure = ["onboard"]
overrides = ["seed=1"]
[grid]
swarm.count = [1, 2]
[random]
lighthouse.tick_ns = { low = 1.0, high = 2.0, log = true, integer = false }
"""


def libsurvive() -> str:
    tables = []
    for number, fcal in FCAL.items():
        pairs = [f'"fcal{key}":["{x:f}","{y:f}"]' for key, (x, y) in fcal.items()]
        pose = '"pose":["1","2","3","1","0","0","0"]'
        tables.append(
            f'"lighthouse{number}":{{\n"index":"{number}"\n"OOTXSet":"1"\n{pose}\n' + "\n".join(pairs) + "\n}"
        )
    return '"v":"0"\n' + "\n".join(tables) + "\n"


def written(folder: Path, name: str, text: str) -> Path:
    file = folder / name
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    return file


def test_scenario_files(tmp_path: Path) -> None:
    texts = [path.read_text() for path in scenarios().values()]

    def read(text: str) -> None:
        settings = load(written(tmp_path, "mutant.toml", text))
        again = load(written(tmp_path, "again.toml", to_toml(settings)))
        assert again == settings

    assert tracebacks(texts, read) == []


def test_accepted_scenarios_are_built_or_refused(tmp_path: Path) -> None:
    texts = [scenarios()[name].read_text() for name in ("static", "crossing", "orbit")]
    assert list(faults(range(40), of_scenarios(texts, tmp_path), nullcontext)) == []


def test_recordings(tmp_path: Path) -> None:
    text = "\n".join(made_recording.lines(made_recording.Made(duration_s=0.7)))
    assert list(faults(range(6), of_recordings(text, tmp_path), nullcontext)) == []


def test_overrides(tmp_path: Path) -> None:
    data = {"name": "x", "swarm": {"count": 1}, "craft": [{"name": "a"}, {"name": "b"}]}
    assert tracebacks(OVERRIDES, lambda text: validate(dict(data), [text], file="x", folder=tmp_path)) == []


def test_study_files(tmp_path: Path) -> None:
    texts = [WHOLE_STUDY, *(path.read_text() for path in studies().values())]

    def read(text: str) -> None:
        study = load_study(written(tmp_path, "mutant.toml", text))
        again = load_study(written(tmp_path, "again.toml", study_toml(study)))
        assert again == study

    assert tracebacks(texts, read) == []


def test_calibration_files(tmp_path: Path) -> None:
    assert tracebacks([OURS, libsurvive()], lambda text: read_calibration(written(tmp_path, "mutant", text))) == []


def test_the_objects_of_recordings() -> None:
    config = {
        "lighthouse_config": {
            "modelPoints": POINTS.tolist(),
            "modelNormals": NORMALS.tolist(),
            "channelMap": CHANNELS,
        },
        "trackref_from_head": [0.0, 0.0, 0.0, 1.0, 0.1, 0.2, 0.3],
        "head": {"plus_x": [1, 0, 0], "plus_z": [0, 0, 1], "position": [0, 0, 0.1]},
        "device_class": "hmd",
    }
    without = {key: value for key, value in config.items() if key != "trackref_from_head"}
    assert tracebacks([json.dumps(config), json.dumps(without)], lambda text: read_config(text, "line 3")) == []


@pytest.mark.parametrize("value", HOSTILE)
@pytest.mark.parametrize("key", ["swarm", "navigation", "craft", "craft[0]", "swarm.model", "navigation.calibration"])
def test_a_hostile_value_in_the_place_of_a_table_or_a_path(tmp_path: Path, key: str, value: str) -> None:
    data = {"swarm": {"count": 1}, "craft": [{"name": "a"}]}
    with pytest.raises(SwarmError) as caught:  # noqa: PT012
        validate(data, [f"{key}={value}"], file="x", folder=tmp_path)
        raise SwarmError("taken")
    assert len(str(caught.value)) < 2000


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('swarm = "s.toml"', "expected a table"),
        ('navigation = "s.toml"', "expected a table"),
        ('[swarm]\nmodel = "' + "a/" * 3000 + 'x.xml"', "file name too long"),
        ('[swarm]\nmodel = "~nosuchuser/x"', "there is no such user"),
        ('[swarm]\nmodel = "a\\u0000b"', "a path has no zero byte"),
        ('[navigation]\ncalibration = "a\\u0000b"', "a path has no zero byte"),
        ("x = " + "[" * 3000, "deep inside each other"),
        ("a" + ".a" * 3000 + " = 1", "deep inside each other"),
        ("seed = " + "9" * 5000, "within 64 bits"),
        ("seed = 0x" + "f" * 5000, "within 64 bits"),
        ("description = 1979-13-45", "not TOML"),
    ],
    ids=lambda text: text[:30],
)
def test_texts_that_ended_in_a_traceback_are_one_message(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SwarmError) as caught:
        load(written(tmp_path, "bad.toml", text))
    assert message in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_a_line_break_does_not_hide_a_second_change() -> None:
    for text in ("swarm.count=2\nseed=5", "name=a\nb", "swarm.count=2\n[navigation]"):
        with pytest.raises(SwarmError, match="--set"):
            parse_override(text)
    assert parse_override("craft[0].motion.from_m=[1,\n2,\n3]").value == [1, 2, 3]
    assert parse_override("swarm.count=2\n").value == 2


def test_what_is_no_unicode_is_refused() -> None:
    for read in (lambda text: parse_toml(f"x = '{text}'", "x"), lambda text: user_path(text), parse_override):
        with pytest.raises(SwarmError, match="not UTF-8 text"):
            read("name=\udcff")
    with pytest.raises(SwarmError, match="not UTF-8 text"):
        parse_json('{"a": "\\ud800"}', "x")


def test_a_mutant_is_the_same_for_good() -> None:
    assert [mutant(["a = 1\n[b]\nc = 'd'\n"], number) for number in range(50)] == [
        mutant(["a = 1\n[b]\nc = 'd'\n"], number) for number in range(50)
    ]
    assert len({mutant(["a = 1\n[b]\nc = 'd'\n"], number) for number in range(50)}) > 30
