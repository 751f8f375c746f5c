"""The report's section of several stations."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from swarm.report.sections.stations import section


def subject(**rows: Any) -> Any:
    """Return a run of two craft and four periods, of which the first craft alone has photodiodes."""
    columns = {name: np.array([part, part], dtype=np.float64).T for name, part in rows.items()}
    series = SimpleNamespace(of=columns.__getitem__, has=columns.__contains__, lit=np.array([0]), time_s=np.arange(4.0))
    return cast(
        Any, SimpleNamespace(series=series, run=SimpleNamespace(telemetry=SimpleNamespace(column_names=[*rows])))
    )


def test_rows_are_summed_by_station() -> None:
    found = section(subject(rows=[9, 9, 9, 9], rows_a=[6, 6, 0, 0], rows_b=[0, 2, 2, np.nan]))
    assert found is not None
    assert found.paragraphs[0].endswith("0 in 25.0 %, 1 in 50.0 %, 2 in 25.0 % of the craft's time.")
    assert [row[:4] for row in found.tables[0].rows] == [["a", "12", "75.0", "50.0"], ["b", "4", "25.0", "50.0"]]
    assert len(found.pictures) == 1


def test_hits_lost_to_two_beams_are_told() -> None:
    light = {"rows": [9, 9, 9, 9], "rows_a": [6, 6, 0, 0], "rows_b": [0, 2, 2, 0]}
    found = section(subject(**light, overlaps=[0, 3, 1, 0]))
    assert found is not None
    assert "4 hits lost, 20.0 % of them" in found.paragraphs[1]
    assert found.paragraphs[1].endswith("at most 3 of a craft in a period.")
    none = section(subject(**light, overlaps=[0, 0, 0, 0]))
    assert none is not None
    assert none.paragraphs[1].endswith("at once: 0 hits lost.")
    unknown = section(subject(**light))
    assert unknown is not None
    assert len(unknown.paragraphs) == 1


def test_one_lighthouse_has_no_such_section() -> None:
    assert section(subject(rows=[9, 9, 9, 9])) is None
    assert section(subject(rows_a=[0, 0, 0, 0])) is None
