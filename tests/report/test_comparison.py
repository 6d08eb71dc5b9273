"""Published numbers: read, found in the result, judged, written and read back."""

from dataclasses import replace

import pytest
from pandas.testing import assert_frame_equal

from heliosweep.errors import StudyError
from heliosweep.report.comparison import compare, comparison_csv, read_comparison, read_published
from tests.report.synthetic import BOTH, result

NUMBER = "must be a finite number"
CLAIMS = "claim,quantity,published,unit,tolerance,reason,verdict\n"
HEADER = "tracking,latitude,quantity,published,unit,tolerance\n"


@pytest.fixture
def dataset():
    data = result({"latitude": [0.0, 15.0, 30.0], "tracking": BOTH})
    data["field_cosine_efficiency"][:] = [[0.8499, 0.8499], [0.84475, 0.84475], [0.8286, 0.8286]]
    return data


@pytest.fixture
def table(tmp_path):
    """Reads a table of the given text."""

    def read(text):
        path = tmp_path / "table.csv"
        path.write_text(text, encoding="utf-8")
        return read_published(path, "A paper", "table.csv")

    return read


def problems(action, *arguments):
    with pytest.raises(StudyError) as caught:
        action(*arguments)
    return [str(problem) for problem in caught.value.problems]


def test_numbers_within_their_tolerance_agree_and_others_differ(dataset, table):
    rows = (
        "spinning_elevation,0,field_cosine_efficiency,84.99,percent,0\n"
        "azimuth_elevation,15,field_cosine_efficiency,84.45,percent,0.025\n"
        "azimuth_elevation,15,field_cosine_efficiency,84.45,percent,0.0249\n"
        "azimuth_elevation,30.0000000001,field_cosine_efficiency,0.83,1,0.001\n"
    )
    compared = compare(dataset, table(HEADER + rows))
    assert [*compared.values["verdict"]] == ["agrees", "agrees", "does not agree", "does not agree"]
    assert [*compared.values["difference"]] == pytest.approx([0, 0.025, 0.025, -0.0014])
    assert compared.summary == "2 of 4 published values agree; largest difference 0.025 percentage points and 0.0014"
    table = compared.table(dataset)
    assert [one.title for one in table.columns[:3]] == ["quantity", "tracking", "latitude (°\N{NO-BREAK SPACE}N)"]
    assert [one.values[1] for one in table.columns[3:6]] == ["84.475", "84.45", "+0.025"]
    assert table.classes == ["agrees", "agrees", "differs", "differs"]


def test_all_that_does_not_fit_the_result_is_told_at_its_line(dataset, table):
    rows = (
        "# a comment counts as a line\n"
        "spinning_elevation,0,field_cosine_eficiency,84.99,percent,0\n"
        "spinning_elevation,10,field_cosine_efficiency,84.99,percent,0\n"
        ",0,field_cosine_efficiency,84.99,percent,0\n"
        "spinning_elevation,equator,field_cosine_efficiency,84.99,percent,0\n"
    )
    assert problems(compare, dataset, table(HEADER + rows)) == [
        "table.csv:3: unknown quantity 'field_cosine_eficiency'; did you mean 'field_cosine_efficiency'?",
        "table.csv:4: latitude '10' is not in the result, which has 0, 15, 30",
        "table.csv:5: 'tracking' is missing: field_cosine_efficiency has 2 values along it",
        "table.csv:6: latitude 'equator' is not in the result, which has 0, 15, 30",
    ]
    odd = "latitud,tracking,quantity,published,unit,tolerance\n0,spinning_elevation,field_cosine_efficiency,1,1,1\n"
    assert problems(compare, dataset, table(odd)) == [
        "table.csv:2: unknown coordinate 'latitud'; did you mean 'latitude'?"
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ["table.csv: is empty: it needs a header and numbers"]),
        (HEADER, ["table.csv: has a header but no published numbers: add one row for each"]),
        ("latitude,quantity\n0,a\n", [
            "table.csv:1: needs a column published: published number, exactly as printed",
            "table.csv:1: needs a column unit: unit of the published number, such as 1, percent, deg or m",
            "table.csv:1: needs a column tolerance: maximum difference for agreement",
        ]),
        (HEADER.replace("tracking", "latitude") + ",,a,1,1,1\n",
         ["table.csv:1:10: has two columns 'latitude'; remove one"]),
        (HEADER + "a,0,b,about 3,1,1\na,0,b,1,,1\na,0,b,1,1,-1\na,0,b\na,0,b,nan,1,1\na,0,b,1,1,\na,0,,1,1,1\n", [
            f"table.csv:2:7: published {NUMBER} (got 'about 3')", "table.csv:3:9: unit is empty",
            "table.csv:4:11: tolerance must be at least 0 (got '-1')",
            "table.csv:5: has 3 fields, but the header has 6", f"table.csv:6:7: published {NUMBER} (got 'nan')",
            "table.csv:7:11: tolerance is empty", "table.csv:8:5: quantity is empty",
        ]),
        (CLAIMS + "T,a,1,1,0,,maybe\n", ["table.csv:2:12: verdict must be 'agrees' or 'does not agree' (got 'maybe')"]),
        (CLAIMS + "T,a,> 1,1,0,,\n", [f"table.csv:2:5: published {NUMBER} (got '> 1')"]),
    ],
)  # fmt: skip
def test_bad_tables(table, text, expected):
    assert problems(table, text) == expected


def test_the_stored_comparison_reads_back(dataset, table, tmp_path):
    published = table(HEADER + "azimuth_elevation,15,field_cosine_efficiency,84.450,percent,0.07\n")
    compared = replace(compare(dataset, published), source="A paper,\ntwo lines")
    path = tmp_path / "comparison.csv"
    path.write_text(comparison_csv(compared), encoding="utf-8")
    stored = read_comparison(path)
    assert (stored.source, stored.summary) == (compared.source, compared.summary)
    assert_frame_equal(stored.values, compared.values.reset_index(drop=True), check_like=True)
    path.write_text(HEADER + "a,0,b,1,1,1\n", encoding="utf-8")
    assert "is not a comparison written by heliosweep" in problems(read_comparison, path)[0]
