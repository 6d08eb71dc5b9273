"""Bad studies of each family: everything wrong is said at once, with file, line, key and remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from heliosweep.families.family import study_classes
from tests import bad_studies

FILES = sorted(Path(__file__).parent.glob("*/bad_studies.txt"))


@pytest.mark.parametrize(("case", "good", "tables"), [case for path in FILES for case in bad_studies.sections(path)])
def test_bad_study(case, good, tables, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in tables.items():
        Path(name).write_text(text, encoding="utf-8")
    bad_studies.check(case, good, study_classes())
