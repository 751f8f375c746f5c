"""The notebooks of docs/notebooks, executed in a Jupyter kernel: whether they run through, and how long they take.

    python benchmarks/notebooks.py [--keep FOLDER] [--out notebooks.json]

Needs the extra `notebooks`. With --keep, executed copies with their outputs are written to a folder. Exit code 1 where
a cell fails.
"""

import tempfile
import time
from pathlib import Path
from typing import Any

import nbformat
from harness import finish, options, show
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

BOOKS = Path(__file__).parents[1] / "docs" / "notebooks"


def main() -> int:
    """Execute all and print."""
    asked = options(__doc__, keep=("", "folder for executed copies"))
    result: dict[str, Any] = {}
    for file in sorted(BOOKS.glob("*.ipynb")):
        book = nbformat.read(file, as_version=4)
        begin, failed = time.monotonic(), ""
        with tempfile.TemporaryDirectory() as folder:
            try:
                NotebookClient(book, timeout=600, resources={"metadata": {"path": folder}}).execute()
            except CellExecutionError as error:
                failed = str(error).strip().splitlines()[-1]
        pictures = sum("image/png" in out.get("data", {}) for cell in book.cells for out in cell.get("outputs", []))
        result[file.stem] = {"seconds": time.monotonic() - begin, "pictures": pictures, "failed": failed}
        if asked.keep:
            Path(asked.keep).mkdir(parents=True, exist_ok=True)
            nbformat.write(book, Path(asked.keep) / file.name)
    show("Notebooks", ("", "s", "pictures", "failed"), [(name, *row.values()) for name, row in result.items()])
    finish("notebooks", result, asked.out)
    return int(any(row["failed"] for row in result.values()))


if __name__ == "__main__":
    raise SystemExit(main())
