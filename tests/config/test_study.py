"""The study as a whole: parameters, dimensions, identity, round trips."""

from pathlib import Path

import pvlib
import pytest

from heliosweep.config.load import load
from heliosweep.errors import StudyError

from .conftest import REGISTRY


def test_dimensions_in_the_order_of_the_family(load_study) -> None:
    study = load_study(
        heliostat="heliostat: {height: [1, 2], width: [3, 4], pivot_height: {start: 1, stop: 3, num: 3}}",
        receiver="receiver: {height: [95, 105]}",
        layout="layout: {radial_stagger: {clearance: [16, 17], inner_radius: 60, rings: 3}}",
        site="tracking: [azimuth_elevation]",
        tracking="site: {latitude: [1, 2, 3]}",
    )
    names = "latitude tracking clearance heliostat_width heliostat_height pivot_height receiver_height"
    assert [dimension.name for dimension in study.dimensions()] == names.split()
    assert [len(dimension) for dimension in study.dimensions()] == [3, 1, 2, 2, 2, 3, 2]
    assert list(study.sweeps()) == [key for dimension in study.dimensions() for key in dimension.sweeps]


def test_zip_ties_parameters(load_study) -> None:
    lines = {
        "heliostat": "heliostat: {width: [3, 4], height: [1, 2], pivot_height: 3}",
        "receiver": "receiver: {height: [95, 105]}",
    }
    study = load_study("zip: [[receiver_height, heliostat.width, heliostat_height]]", **lines)
    (tied,) = study.dimensions()
    assert tied.name == "receiver_height"
    assert list(tied.sweeps) == ["receiver.height", "heliostat.width", "heliostat.height"]
    with pytest.raises(StudyError, match=r"zip\[0\]: ties sweeps of different lengths: receiver.height has 2, site"):
        load_study("zip: [[receiver_height, latitude]]", **lines, site="site: {latitude: [1, 2, 3]}")


@pytest.mark.parametrize("name", ["./a.csv", "../{folder}/a.csv", "{path}"])
def test_a_file_is_not_swept_under_two_names(study_file, name) -> None:
    """The resolved study would name it twice, and not load."""
    Path("a.csv").write_text("x,y\n0,50\n")
    here = Path.cwd()
    name = name.format(folder=here.name, path=here / "a.csv")
    with pytest.raises(StudyError, match=r"layout\.file\[1\]: is the same file as 'a\.csv': list each file once"):
        load(study_file(layout=f"layout: {{file: [a.csv, '{name}']}}"), REGISTRY)


def test_identity_survives_rewriting(load_study) -> None:
    reference = load_study().study_id
    assert len(reference) == 12
    same = [
        {"site": "site:\n  latitude: 30.0   # a comment"},
        {"time": "time: {hours: {num: 41, stop: 16, start: 8}, sampling: inclusive, clock: solar}"},
        {"time": "time: {clock: solar, hours: {start: 480 min, stop: 16 h, step: 12 min}}"},
        {"time": "time: {clock: solar, hours: {start: 8, stop: 16, num: 41}, days: {start: 1, stop: 365, step: 1}}"},
        {"receiver": "execution: {workers: 3}\nreceiver: {height: 9500 cm}"},
        {"title": "title: other", "receiver": "output: {time_series: true}\nreceiver: {height: 0.095 km}"},
        {"family": "receiver: {height: 95}", "receiver": "family: field_efficiency"},
    ]
    assert [load_study(**lines).study_id for lines in same] == [reference] * len(same)
    different = [
        {"site": "site: {latitude: 30.000001}"},
        {"site": "site: {latitude: [30]}"},
        {"tracking": "tracking: azimuth_elevation"},
        {"time": "time: {clock: solar, hours: {start: 8, stop: 16, step: 0.2}, sampling: left}"},
    ]
    assert len({load_study(**lines).study_id for lines in different} | {reference}) == len(different) + 1


def test_identity_holds_the_contents_of_files(study_file) -> None:
    path, layout = study_file(layout="layout: {file: a.csv}"), Path("a.csv")
    layout.write_text("x,y\n0,50\n")
    first = load(path, REGISTRY).study_id
    layout.write_text("x,y\n0,51\n")
    study = load(path, REGISTRY)
    assert study.study_id != first
    layout.unlink()
    with pytest.raises(StudyError, match=r"study.yaml:5:16: layout.file: cannot read a.csv"):
        _ = study.study_id


@pytest.mark.parametrize(
    ("same", "others"),
    [
        (["[0, 15, 30]", "{start: 0, stop: 30, step: 15}", "{start: 0, stop: 30, num: 3}"], ["[0, 30, 15]", "[0, 15]"]),
        (["[0.1, 0.2, 0.3]", "{start: 0.1, stop: 0.3, step: 0.1}"], ["[0.1, 0.2, 0.30000000000000004]"]),
        (["[30]", "{start: 30, stop: 31, step: 2}"], ["30"]),
        (["[3, 5]", "{start: 3, stop: 5, num: 2}"], ["[5, 3]"]),
    ],
)
def test_identity_of_lists_is_that_of_ranges(load_study, same: list[str], others: list[str]) -> None:
    identities = {text: load_study(site=f"site: {{latitude: {text}}}").study_id for text in same + others}
    assert len({identities[text] for text in same}) == 1
    assert len(set(identities.values())) == 1 + len(others)


def test_files_of_pvlib_keep_their_names(study_file) -> None:
    name = "pvlib:data/723170TYA.CSV"
    lines = {"site": f"site: {{file: '{name}'}}", "time": f"time: {{clock: weather}}\nweather: {{file: '{name}'}}"}
    study = load(study_file(**lines), REGISTRY)
    assert study.resolve(name) == Path(pvlib.__file__).parent / "data" / "723170TYA.CSV"
    assert study.site is not None
    assert study.site.latitude == 36.1
    again = Path("elsewhere/study.yaml")
    again.parent.mkdir()
    again.write_text(study.to_yaml(again.parent))
    assert load(again, REGISTRY).files() == study.files() == {"weather.file": (name,)}
    assert load(again, REGISTRY).study_id == study.study_id


def test_resolved_study_names_files_as_seen_from_its_folder(study_file) -> None:
    for name in ("studies", "tables", "outputs/one"):
        Path(name).mkdir(parents=True)
    Path("tables/a.csv").write_text("x,y\n0,50\n")
    Path("studies/b.csv").write_text("x,y\n0,60\n")
    Path("studies/sites.csv").write_text("name,latitude\nhere,3\n")
    Path("studies/table.csv").write_text("latitude,value\n")
    lines = {
        "site": "sites: {file: sites.csv}",
        "layout": "layout: {file: [../tables/a.csv, b.csv]}",
        "receiver": "report: {published: {file: table.csv, source: here}}\nreceiver: {height: 95}",
    }
    study = load(study_file(**lines).rename("studies/study.yaml"), REGISTRY)
    assert study.source.directory == Path("studies")
    assert study.resolve("b.csv") == Path("studies/b.csv")
    resolved = Path("outputs/one/study.resolved.yaml")
    resolved.write_text(study.to_yaml(resolved.parent))
    again = load(resolved, REGISTRY)
    assert again.study_id == study.study_id
    assert again.files() == {
        "sites.file": ("../../studies/sites.csv",),
        "layout.file": ("../../tables/a.csv", "../../studies/b.csv"),
        "report.published.file": ("../../studies/table.csv",),
    }


@pytest.mark.parametrize(
    "lines",
    [
        {},
        {"site": "site: {latitude: {start: -60, stop: 60, step: 2}, timezone: '+08:00'}\ntitle: '1e-3'"},
        {"time": "time: {clock: solar, hours: 12, declination: {start: -23.45, stop: 23.45, num: 7}}"},
        {"site": "site: {latitude: 48, longitude: 2}",
         "time": "time: {clock: civil, dates: {start: 2021-01-01, stop: 2021-01-31, step: 7},"
                 " window: {start: 7:00, stop: 12:30, step: 10 min}, timezone: Europe/Paris, sampling: midpoint}"},
        {"site": "sites: [{name: 'no', latitude: 3}, {name: b, latitude: 4, longitude: 5}]"},
        {"layout": "layout: {radial_stagger: {inner_radius: 60, rings: [3, 4],"
                   " clearance: {logspace: {start: 12, stop: 20, num: 3}}}}"},
        {"receiver": "receiver: {height: [95, 96]}\nzip: [[tracking, receiver_height]]",
         "tracking": "tracking: [azimuth_elevation, spinning_elevation]"},
    ],
)  # fmt: skip
def test_resolved_study_loads_to_the_same(load_study, lines: dict[str, str]) -> None:
    study = load_study(**lines)
    Path("resolved.yaml").write_text(study.to_yaml(), encoding="utf-8")
    again = load(Path("resolved.yaml"), REGISTRY)
    assert again.canonical() == study.canonical()
    assert again.study_id == study.study_id
    assert again.title == study.title
    assert again.to_yaml() == study.to_yaml()
