"""What the benchmark of commands says is what ran."""

import pytest

from tests.bench.bench_study import TINY, run
from tests.bench.table import BEGIN, END, Line, rate, write_page


def test_a_run_that_finds_its_result_is_not_told_as_one_that_computes(tmp_path):
    study = tmp_path / "tiny.yaml"
    study.write_text(TINY)
    seconds, memory, manifest = run(study, tmp_path / "out", "--no-report")
    assert seconds > manifest["seconds"]["compute"] > 0.0
    assert memory > 50.0
    with pytest.raises(SystemExit, match=r"tiny\.yaml found its result"):
        run(study, tmp_path / "out", "--no-report")
    run(study, tmp_path / "out", "--no-report", found=True)
    with pytest.raises(SystemExit, match=r"tiny\.yaml computed its result"):
        run(study, tmp_path / "out", "--no-report", "--force", found=True)


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
