"""The wheel, installed somewhere else, flies: nothing of the checkout is needed, and nothing foreign is in it."""

import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return next(out.glob("*.whl"))


def test_the_wheel_carries_code_models_and_scenarios_and_nothing_else(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"swarm", "estimators"}
    for wanted in (
        "swarm/models/craft/mockup/mockup.xml",
        "swarm/scenarios/formation.toml",
        "swarm/scenarios/studies/scaling.toml",
        "swarm/scenarios/recordings/handheld.rec.gz",
        "swarm/scenarios/recordings/handheld.json",
        "swarm/report/templates/report.html.j2",
        "swarm/cli/app.py",
        "swarm/docs/scenario.md",
        "swarm/docs/scenario.schema.json",
    ):
        assert wanted in names
    assert not [name for name in names if name.endswith(".png")]
    assert not [name for name in names if "__pycache__" in name or name.endswith((".nbi", ".nbc", ".rrd"))]


def test_the_installed_wheel_flies_outside_the_checkout(wheel, tmp_path):
    # Dependencies come from this environment, by a path file; the product itself only from the wheel.
    home = tmp_path / "venv"
    venv.create(home, with_pip=False)
    python = home / "bin" / "python"
    here = subprocess.run(
        [python, "-c", "import site; print(site.getsitepackages()[0])"], capture_output=True, text=True, check=True
    )
    packages = Path(here.stdout.strip())
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(packages)
    (packages / "dependencies.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [python, "-m", "swarm", "run", "static", "--set", "duration_s=0.2", "--no-recording"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "static-3" / "telemetry.parquet").exists()
    assert str(packages) in output_of(python, "import swarm; print(swarm.__file__)", cwd=tmp_path, env=environment)


def test_an_editable_install_is_the_checkout(tmp_path):
    build = f"from hatchling.build import build_editable; print(build_editable({str(tmp_path)!r}))"
    name = output_of(Path(sys.executable), build, cwd=ROOT).splitlines()[-1]
    packages = tmp_path / "packages"
    with zipfile.ZipFile(tmp_path / name) as archive:
        archive.extractall(packages)
    dependencies = [path for path in sys.path if path.endswith("site-packages")]
    found = output_of(
        Path(sys.executable),
        f"import site, sys; sys.path[:] = [p for p in sys.path if p not in {dependencies!r}]; "
        f"site.addsitedir({str(packages)!r}); sys.path += {dependencies!r}; "
        "import swarm; from swarm.assets import folder; print(swarm.__file__, folder('models'))",
        cwd=tmp_path,
        env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
    )
    assert found == f"{ROOT / 'swarm' / '__init__.py'} {ROOT / 'models'}"


def output_of(python: Path, code: str, **where) -> str:
    done = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True, **where)
    return done.stdout.strip()
