"""What is never written over: sources, and what a run has left."""

import shutil
from pathlib import Path

import pytest

from heliosweep import run, save
from heliosweep.cli import main

FIELD = "x,y\n0,60\n15,60\n"
TMY3 = '724666,"DENVER",CO,-7.0,39.742,-105.179,1829\nDate (MM/DD/YYYY),Time (HH:MM)\n'


@pytest.fixture(scope="module")
def made(small, tmp_path_factory) -> Path:
    """Folder with two studies, a layout, a weather file and two results."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("made"))
        Path("field.csv").write_text(FIELD)
        Path("denver.csv").write_text(TMY3)
        save(small(), "tower.yaml")
        save(small(layout={"file": "field.csv"}), "named.yaml")
        civil = Path("tower.yaml").read_text().replace("latitude:", "file: denver.csv\n  latitude:")
        Path("weather.yaml").write_text(civil)
        run(small(), "D", report=False)
        run(small(layout={"file": "field.csv"}), "E", report=False)
        return Path.cwd()


@pytest.fixture
def folder(made, tmp_path, monkeypatch) -> Path:
    """Working directory with a copy of them."""
    monkeypatch.chdir(shutil.copytree(made, tmp_path, dirs_exist_ok=True))
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("convert tower.yaml tower.yaml", "tower.yaml: must end in .csv"),
        ("convert field.csv field.csv", "field.csv: is an input"),
        ("convert field.csv D/../field.csv", "field.csv: is an input"),
        ("convert named.yaml field.csv", "field.csv: is an input"),
        ("convert weather.yaml denver.csv", "denver.csv: is an input"),
        ("convert tower.yaml D/comparison.csv", "D/comparison.csv: belongs to a result"),
        ("convert tower.yaml D/figures/a.csv", "D/figures/a.csv: belongs to a result"),
        ("export D --csv D/manifest.json --variable optical_efficiency", "D/manifest.json: must end in .csv"),
        ("export D --csv D/comparison.csv --variable optical_efficiency", "D/comparison.csv: belongs to a result"),
        ("export E --csv field.csv --variable optical_efficiency", "field.csv: is an input"),
        ("table E -o field.csv", "field.csv: is an input"),
        ("table tower.yaml -o D/result.nc", "D/result.nc: must end in .csv"),
        ("table tower.yaml -o tower.yaml", "tower.yaml: must end in .csv"),
        ("table named.yaml -o field.csv", "field.csv: is an input"),
    ],
)
def test_refused_with_force_also(folder, capsys, command, said):
    before = contents(folder)
    assert main([*command.split(), "--force"]) == 2
    assert said in capsys.readouterr().err
    assert contents(folder) == before
