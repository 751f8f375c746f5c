"""The tests that need optional extras, in an environment of their own that has them: `pytest -m long`."""

import os
import subprocess
import sys
import tomllib
import venv
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
EXTRAS = {"video": "tests/test_video.py", "gym": "tests/test_environments.py", "mcap": "tests/test_export.py"}
"""Extras of pyproject.toml, and the tests that are skipped without them."""

TOLD: dict[str, Any] = {
    "capture_output": True,
    "text": True,
    "check": False,
    "env": {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")},
}


@pytest.mark.long
def test_nothing_is_skipped_where_the_extras_are_installed(tmp_path: Path) -> None:
    known = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    venv.create(tmp_path / "venv", with_pip=True)
    python = str(tmp_path / "venv" / "bin" / "python")
    here = subprocess.run([python, "-c", "import site; print(site.getsitepackages()[0])"], **TOLD)
    # Everything else comes from this environment, by a path file.
    dependencies = "\n".join(path for path in sys.path if path.endswith("site-packages"))
    (Path(here.stdout.strip()) / "dependencies.pth").write_text(dependencies)
    wanted = [package for extra in EXTRAS for package in known[extra]]
    installed = subprocess.run([python, "-m", "pip", "install", "--quiet", *wanted], **TOLD)
    assert installed.returncode == 0, installed.stderr
    done = subprocess.run([python, "-m", "pytest", "-q", "-n", "0", *EXTRAS.values()], cwd=ROOT, **TOLD)
    assert done.returncode == 0, done.stdout[-4000:]
    if "cannot draw" not in done.stdout:
        assert " skipped" not in done.stdout, done.stdout[-4000:]
