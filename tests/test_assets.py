"""Models and scenarios are found by name and by path, in a checkout and in an installed package."""

import pytest

from swarm import assets
from swarm.errors import SwarmError


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package folder with models/ and scenarios/ inside, as the wheel lays them out."""
    package = tmp_path / "site-packages" / "swarm"
    for file in ("models/lighthouse/lighthouse.xml", "models/craft/probe/probe.xml", "models/craft/probe/scene.xml"):
        (package / file).parent.mkdir(parents=True, exist_ok=True)
        (package / file).write_text("<mujoco/>")
    (package / "scenarios").mkdir()
    (package / "scenarios" / "waltz.toml").write_text("")
    monkeypatch.setattr(assets, "PACKAGE", package)
    return package


def test_checkout_has_the_shipped_models():
    assert {"mockup", "cubesat6u"} <= set(assets.models())
    assert assets.models()["mockup"].name == "mockup.xml"
    assert list(assets.lighthouses()) == ["lighthouse"]


def test_checkout_has_the_folder_of_scenarios():
    assert all(path.suffix == ".toml" and path.stem == name for name, path in assets.scenarios().items())


def test_installed_package_keeps_them_inside(installed):
    assert assets.models() == {"probe": installed / "models" / "craft" / "probe" / "probe.xml"}
    assert list(assets.lighthouses()) == ["lighthouse"]
    assert assets.find_scenario("waltz") == installed / "scenarios" / "waltz.toml"


def test_missing_folder_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(assets, "PACKAGE", tmp_path / "swarm")
    with pytest.raises(SwarmError, match="folder models/ is missing"):
        assets.models()


def test_model_by_name_path_and_folder(tmp_path, monkeypatch):
    own = tmp_path / "own" / "own.xml"
    own.parent.mkdir()
    own.write_text("<mujoco/>")
    own.with_name("scene.xml").write_text("<mujoco/>")
    assert assets.find_model("mockup") == assets.models()["mockup"]
    assert assets.find_model("lighthouse") == assets.lighthouses()["lighthouse"]
    assert assets.find_model("own/own.xml", relative_to=tmp_path) == own
    assert assets.find_model("own", relative_to=tmp_path) == own
    assert assets.find_model(own) == own
    monkeypatch.chdir(tmp_path)
    assert assets.find_model("own/own.xml") == own


def test_folder_whose_only_model_has_another_name(tmp_path):
    (tmp_path / "probe.xml").write_text("<mujoco/>")
    (tmp_path / "scene.xml").write_text("<mujoco/>")
    assert assets.find_model(tmp_path) == tmp_path / "probe.xml"
    (tmp_path / "second.xml").write_text("<mujoco/>")
    with pytest.raises(SwarmError, match=r"found probe\.xml, scene\.xml, second\.xml"):
        assets.find_model(tmp_path)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mokcup", "no model 'mokcup'; did you mean 'mockup'"),
        (
            "qqqq",
            "known: berth, chaser, client, cubesat12u, cubesat6u, dotbot, inspector, lighthouse, marker-target, "
            "mockup, plate, satellite, servicer, shuttle",
        ),
        ("craft/mokcup.xml", "mokcup.xml does not exist"),
    ],
)
def test_missing_model(name, message):
    with pytest.raises(SwarmError, match=message):
        assets.find_model(name)


def test_missing_scenario(installed):
    with pytest.raises(SwarmError, match="no scenario 'walz'; did you mean 'waltz'"):
        assets.find_scenario("walz")
    with pytest.raises(SwarmError, match=r"my/walz.toml does not exist; did you mean 'waltz'"):
        assets.find_scenario("my/walz.toml")


def test_scenario_by_path(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text("")
    assert assets.find_scenario(str(own)) == own


def test_studies_are_shipped_and_found():
    assert assets.find_study("scaling") == assets.studies()["scaling"]
    assert "scaling" not in assets.scenarios()
    with pytest.raises(SwarmError, match="no study 'scalin'; did you mean 'scaling'"):
        assets.find_study("scalin")


def test_a_recording_that_comes_along_is_known_with_its_calibration():
    file = assets.recordings()["handheld"]
    assert assets.own_recording(file) == ("handheld", file.parent / "handheld.json")
    assert assets.own_recording(file.with_name("other.rec.gz")) is None
