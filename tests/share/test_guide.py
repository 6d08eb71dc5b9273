"""What a user looks up before writing a study: keys, a study to start from, the studies that come along."""

import re
import subprocess
import sys
import zipfile

import pytest
import yaml

from heliosweep import api
from heliosweep.cli import COMMANDS, main
from heliosweep.config.study import keys_of
from heliosweep.errors import StudyError
from heliosweep.families.family import families
from heliosweep.share.guide import explain
from tests.conftest import ROOT, STUDIES


def test_a_key_is_explained():
    text = explain(["field_efficiency", "receiver.height"])
    for line in ("Height of the aim point", "number, above 0", "unit     m;", "default  none; the key is required",
                 "example  receiver: {height: 95}", "sweep    [A, B, C]"):  # fmt: skip
        assert line in text
    assert explain(["sites[0].latitude"]) == explain(["sites[3].latitude"])
    assert "azimuth_elevation: rotated about the vertical, then tilted" in explain(["tracking"])
    assert "sobol: eight independently scrambled Sobol sequences, the most accurate design\n" in explain(
        ["sample.design"]
    )
    assert "averaged over" in explain(["field_efficiency", "time.hours"])
    assert "receiver.height  " in explain(["field_efficiency", "receiver"])


@pytest.mark.parametrize("family", families())
def test_every_key_of_every_family_is_explained(family):
    keys = [key.name for key in keys_of(families()[family].study_class())]
    assert [line.split()[0] for line in explain([family]).splitlines()] == keys
    for key in keys[:: max(1, len(keys) // 40)]:
        assert explain([family, key]).splitlines()[0].startswith(key)


def test_a_new_study_is_written_once(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in families():
        assert main(["new", name]) == 0
        assert capsys.readouterr().out.strip() == f"{name}.yaml"
        assert api.load(f"{name}.yaml").family == name
    assert main(["new", "dish_tracking"]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["new", "dish_tracking", "--force"]) == 0
    assert main(["new", "dish", "my.yaml"]) == 2
    assert "did you mean 'dish_tracking'" in capsys.readouterr().err


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_examples_in_its_help(name, capsys):
    with pytest.raises(SystemExit):
        main([name, "--help"])
    out = capsys.readouterr().out
    assert f"examples:\n  heliosweep {name}" in out


def test_the_wheel_brings_the_studies_with_their_files_and_the_types(tmp_path):
    build = "import sys; from hatchling.build import build_wheel; build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, str(tmp_path)], cwd=ROOT, check=True, timeout=900)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    brought = {name.removeprefix("heliosweep/studies/") for name in names if "/studies/" in name}
    assert {"heliosweep/__init__.pyi", "heliosweep/py.typed"} <= {*names}
    assert brought == {str(path.relative_to(STUDIES)) for path in STUDIES.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("field_receiver_enrgy", "did you mean 'field_receiver_energy'?"),
        ("DNI", "limits.dni"),
        ("sweep", "to sweep a key, replace its value with a list or a range"),
        ("tower_height", "give 'receiver.height'"),
        ("packing", "field_packing"),
        ("washing", "optics.soiling"),
    ],
)
def test_an_unknown_word_leads_to_keys_and_variables_that_are_described_with_it(word, hint):
    with pytest.raises(StudyError, match=re.escape(hint)):
        explain([word])


def test_the_study_to_start_from_shows_blocks_that_are_valid_when_their_comments_go():
    """Whoever begins with `heliosweep new field_efficiency` finds energy, searches and uncertainty."""
    text = families()["field_efficiency"].example()
    shown = dict(yaml.safe_load(line).popitem() for line in re.findall(r"^# (\w+: [{\[][^#\n]*)", text, re.MULTILINE))
    content = yaml.safe_load(text)
    content |= {"site": {"latitude": 30}, "tracking": "azimuth_elevation"}
    measured = "pvlib:data/723170TYA.CSV"
    assert shown["weather"] == {"file": "weather.epw"} == shown["site"]
    energy = {
        "time": shown["time"],
        "limits": shown["limits"],
        "site": {"file": measured},
        "weather": {"file": measured},
    }
    mirror = content["heliostat"]
    for changes in (
        energy,
        {"keep": shown["keep"]},
        {"zip": shown["zip"], "heliostat": mirror | {"width": [11, 12], "height": [10, 11]}},
        {"sample": shown["sample"], "heliostat": mirror | {"width": {"normal": [11, 0.02]}}},
        {"search": shown["search"]},
        {"design_point": shown["design_point"]},
        {"receiver": shown["receiver"], "optics": shown["optics"]},
    ):
        assert api.load(content | changes).family == "field_efficiency"
