"""Tables of sites."""

from pathlib import Path

import pytest

from heliosweep.config.sites import site_notes, site_table
from heliosweep.errors import StudyError

SITE_FILE = "sites: {file: sites.csv}"


def test_table(load_study) -> None:
    Path("sites.csv").write_text("name,latitude,longitude\nDunhuang,40.13,94.67\n# far south\nTimaru,-44.4,\n")
    sites = site_table(load_study(site=SITE_FILE))
    assert [(site.name, site.latitude, site.longitude) for site in sites] == [
        ("Dunhuang", 40.13, 94.67),
        ("Timaru", -44.4, None),
    ]


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (
            "name,latitude\na,91\nb,x\nc,\n",
            "sites.csv:2: latitude: must be between -90 and 90 deg (got 91)\n"
            "sites.csv:3: latitude: must be an angle in deg, a number or text such as '30 deg' (got 'x')\n"
            "sites.csv:4: latitude: is missing: Geographic latitude, positive north [deg]",
        ),
        ("name,latitude,name\na,3,b\n", "sites.csv:1:15: has two columns 'name'; remove one"),
        ("name,height\na,3\n", "sites.csv:1: needs a column latitude: Geographic latitude, positive north [deg]"),
        ("name,latitude\n", "sites.csv: has a header but no sites: add one row for each"),
        ("name,latitude\na,3\nb,4\n\na,5\n", "sites.csv:5: name: another site has this name (got 'a')"),
    ],
)
def test_wrong_tables_are_located(load_study, table: str, said: str) -> None:
    Path("sites.csv").write_text(table)
    with pytest.raises(StudyError) as error:
        site_table(load_study(site=SITE_FILE))
    assert str(error.value) == said


def test_other_titles_and_columns_that_are_not_used(load_study) -> None:
    Path("sites.csv").write_text("Site,Lat,Lon (deg),Elevation,owner,,\nDunhuang,40.13,94.67,1100,x,,\n")
    study = load_study(site=SITE_FILE)
    assert [(site.name, site.latitude, site.longitude, site.altitude) for site in site_table(study)] == [
        ("Dunhuang", 40.13, 94.67, 1100)
    ]
    assert [*site_notes(study)] == ["sites.csv: ignored columns: owner"]
