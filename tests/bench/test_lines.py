"""The table of a benchmark on a page."""

from tests.bench.table import BEGIN, END, Line, rate, write_page


def test_the_table_of_a_page_takes_the_place_of_the_last(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"# Speed\n\n{BEGIN}\nold\n{END}\n\nmore\n")
    row = rate("field sums", "heliostat-instant", 1e-7, {"other": 9e-7})
    for _ in range(2):
        write_page(page, [row, Line("run, tiny", "1.20 s")])
        text = page.read_text()
        assert "| field sums | 10.0 million heliostat-instants/s | 9.00 times the speed of other |" in text
        assert "| run, tiny | 1.20 s |  |" in text
        assert text.startswith(f"# Speed\n\n{BEGIN}\nMeasured on ")
        assert text.endswith(f"\n{END}\n\nmore\n")
    assert "old" not in text
