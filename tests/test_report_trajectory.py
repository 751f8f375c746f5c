"""The report's section of the paths: the lighthouse at the origin, or the stations where they stand."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
import pytest

from swarm.report.sections.trajectory import section
from swarm.results.replayed import FILE


def subject(folder: Path, scenario: dict[str, Any], *, replayed: bool = False) -> Any:
    """Return a run of one craft at (1, 2, 3) m."""
    at = np.tile([1.0, 2.0, 3.0], (4, 1, 1))
    series = SimpleNamespace(replayed=replayed, names=["craft"], position=lambda source: at)
    return cast(Any, SimpleNamespace(series=series, scenario=scenario, run=SimpleNamespace(folder=folder)))


def drawn(found: Any) -> list[dict[str, list[list[float]]]]:
    """Return the points of every label, of each view."""
    assert found is not None
    figure = plt.figure()
    found.pictures[0].paint(figure)
    out = [
        {str(line.get_label()): np.asarray(line.get_xydata()).tolist() for line in axes.lines} for axes in figure.axes
    ]
    plt.close(figure)
    return out


def test_the_lighthouse_is_at_the_origin(tmp_path: Path) -> None:
    found = section(subject(tmp_path, {}))
    assert [view["lighthouse"] for view in drawn(found)] == [[[0, 0]], [[0, 0]]]
    assert found is not None
    assert "stands at the origin" in found.paragraphs[0]


def test_stations_are_where_they_stand_and_the_world_is_upright(tmp_path: Path) -> None:
    tables = [{"position_m": [4, 5, 6]}, {"position_m": [7, 8, 9]}, {"position_m": [0, 0, 0.1], "craft": "chief"}]
    found = section(subject(tmp_path, {"station": tables, "recording": {"up": "z"}}))
    views = drawn(found)
    assert [view["station"] for view in views] == [[[4, 5], [7, 8]], [[4, 6], [7, 9]]]
    assert [view["craft"] for view in views] == [[[1, 2]], [[1, 3]]]
    assert found is not None
    assert "in which the stations stand" in found.paragraphs[0]
    assert [view["station"] for view in drawn(section(subject(tmp_path, {"station": tables})))] == [
        [[6, 4], [9, 7]],
        [[6, 5], [9, 8]],
    ]


@pytest.mark.parametrize("tables", ["none", [1], [{"position_m": "here"}], [{"position_m": [1, 2]}]])
def test_a_scenario_that_was_edited_draws_no_station(tmp_path: Path, tables: Any) -> None:
    assert all("station" not in view for view in drawn(section(subject(tmp_path, {"station": tables}))))


def test_a_replay_knows_its_stations(tmp_path: Path) -> None:
    station = {"name": "0", "generation": "2.0", "position_m": [4.0, 5.0, 6.0], "rotation": np.eye(3).tolist()}
    said = {"up": "z", "photodiodes": {"point_m": [[0, 0, 0]], "normal": [[0, 0, 1]]}, "stations": [station]}
    (tmp_path / FILE).parent.mkdir()
    (tmp_path / FILE).write_text(json.dumps(said))
    found = section(subject(tmp_path, {}, replayed=True))
    assert [view["station"] for view in drawn(found)] == [[[4, 5]], [[4, 6]]]
    (tmp_path / FILE).write_text(json.dumps(said | {"stations": []}))
    assert "lighthouse" in drawn(section(subject(tmp_path, {}, replayed=True)))[0]
