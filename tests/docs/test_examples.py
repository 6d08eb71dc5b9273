"""The examples in the docstrings of public functions run and print their values."""

import doctest
import importlib
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

import heliosweep
from heliosweep.files import named_in

TOWER = """
family: field_efficiency
title: Two towers
site: {latitude: 30}
time: {clock: solar, days: [80], hours: [9, 12, 15]}
tracking: azimuth_elevation
layout: {radial_stagger: {clearance: 16, inner_radius: 40, heliostats: 20}}
heliostat: {width: 11, height: 11, pivot_height: 7}
receiver: {height: [40, 60]}
"""
CYLINDER = """
family: field_efficiency
title: A cylinder
site: {latitude: 30}
time: {clock: solar, days: [80], hours: [12]}
tracking: azimuth_elevation
layout: {radial_stagger: {clearance: 16, inner_radius: 40, heliostats: 20}}
heliostat: {width: 11, height: 11, pivot_height: 7, focus: slant}
receiver: {kind: cylinder, height: 60, radius: 4, height_extent: 8}
optics: {sun_shape: {kind: limb_darkened}, slope_error: 1.5, rays: 64}
output: {flux_map: {rows: 4, columns: 8}}
"""
#: Functions whose examples need files of others or a network.
WITHOUT = {"download_weather", "read_paint", "read_paint_spots", "write_corrections", "write_paint_spots"}
WITHOUT |= {"write_paint_study"}
#: Packages that examples need and that may be missing.
NEEDS = {"plant_electricity": "PySAM", "tower_electricity": "PySAM"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with studies and results that the examples name."""
    made = tmp_path_factory.mktemp("examples")
    (made / "tower.yaml").write_text(TOWER)
    (made / "cylinder.yaml").write_text(CYLINDER)
    tower = heliosweep.load(made / "tower.yaml")
    heliosweep.save(tower.with_({"receiver.height": 50.0}), made / "one_tower.yaml")
    heliosweep.run(tower, made / "result", report=False)
    heliosweep.run(tower.with_({"site.latitude": 20}), made / "other", report=False)
    heliosweep.write_layout(heliosweep.layout_of(heliosweep.load(made / "one_tower.yaml")), made / "layout.csv")
    shutil.copy(named_in(made, "pvlib:data/723170TYA.CSV"), made / "greensboro.csv")
    if find_spec("PySAM"):
        plant = heliosweep.load(made / "cylinder.yaml").with_(
            {
                "site": {"file": "greensboro.csv"}, "weather": {"file": "greensboro.csv"}, "time": {"clock": "weather"},
                "design_point": {"day": 80, "solar_hour": 12, "dni": 900}, "receiver.absorptance": 0.94,
            }
        )  # fmt: skip
        heliosweep.run(plant, made / "plant", report=False)
    return made


@pytest.mark.parametrize("name", [name for name in heliosweep.__all__ if name.islower() and name[0] != "_"])
def test_example(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    function = getattr(heliosweep, name)
    module = importlib.import_module(function.__module__)
    tests = [test for test in doctest.DocTestFinder(recurse=False).find(function, name, module) if test.examples]
    assert tests or name in WITHOUT, f"{name} has no example"
    if name in NEEDS:
        pytest.importorskip(NEEDS[name], reason="its example needs this package")
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    assert all(runner.run(test).failed == 0 for test in tests), "see the output"
