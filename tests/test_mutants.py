"""Mutants fit the code: a fault whose text has changed would be put in nowhere."""

from tests.mutants import PACKAGE, ROOT, read


def test_each_mutant_fits_the_code():
    mutants = read(ROOT / "tests" / "mutants.txt")
    texts = {one.file: (ROOT / PACKAGE / one.file).read_text(encoding="utf-8") for one in mutants}
    assert [one.old for one in mutants if texts[one.file].count(one.old) != 1] == []
