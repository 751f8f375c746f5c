"""The report's section of several stations."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from swarm.report.sections.stations import section


def subject(**rows: Any) -> Any:
    """Return a run of two craft and four periods, of which the first craft alone has photodiodes."""
    columns = {name: np.array([part, part], dtype=np.float64).T for name, part in rows.items()}
    series = SimpleNamespace(of=columns.__getitem__, lit=np.array([0]), time_s=np.arange(4.0))
    return cast(
        Any, SimpleNamespace(series=series, run=SimpleNamespace(telemetry=SimpleNamespace(column_names=[*rows])))
    )


def test_rows_are_summed_by_station() -> None:
    found = section(subject(rows=[9, 9, 9, 9], rows_a=[6, 6, 0, 0], rows_b=[0, 2, 2, np.nan]))
    assert found is not None
    assert found.paragraphs[0].endswith("0 in 25.0 %, 1 in 50.0 %, 2 in 25.0 % of the craft's time.")
    assert [row[:4] for row in found.tables[0].rows] == [["a", "12", "75.0", "50.0"], ["b", "4", "25.0", "50.0"]]
    assert len(found.pictures) == 1


def test_one_lighthouse_has_no_such_section() -> None:
    assert section(subject(rows=[9, 9, 9, 9])) is None
    assert section(subject(rows_a=[0, 0, 0, 0])) is None
