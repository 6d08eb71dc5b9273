"""Table 1 of Defieux, Caliot and Henault (2020), doi 10.1063/5.0029270, from the shipped studies.

The paper prints neither where sun and cameras stood nor the modules and the profile it measured; the studies assume
them. What is asked here is what the paper claims, and what the studies' description in `studies/README.md` states.
"""

from __future__ import annotations

import numpy as np
import pytest

from heliosweep import api
from heliosweep.report.comparison import AGREES, compare, read_published
from tests.conftest import STUDIES
from tests.literature.claims import defieux2020

TABLE = read_published(STUDIES / "published" / "defieux2020_table1.csv")
PAPER = ("A", "O1", "O2")
NUMBERS = [f"Table 1: {method} {profile}" for method in PAPER for profile in ("clean", "noisy")]
PUBLISHED = [one for one in TABLE.values if one.claim in NUMBERS]


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("defieux2020") / "out"
    study = api.load(STUDIES / "defieux2020_table1.yaml", {"execution.memory": "700 MB"})
    with api.run(study, folder, report=False).open() as stored:
        return stored.load()


def test_noisy_o2_is_the_best_of_the_paper_s_methods(result):
    """Without a referential: in every one of 64 seeds by the root mean square of its four errors and by the largest."""
    at = result.sel(module=[2, 3], referential="none")
    dims = ("sun_profile", "profile_seed", "slope_method", "module")
    table = np.stack([at[f"relative_error_{axis}"].transpose(*dims) for axis in "xy"], axis=-1)
    assert result["slope_method"].values.tolist() == [*PAPER, "LM"]
    assert (table[0] == table[0, :1]).all()  # nothing of the clean profile is random
    for reduce in (lambda errors: np.sqrt(np.mean(errors**2, axis=(2, 3))), lambda errors: errors.max(axis=(2, 3))):
        size = reduce(table[1])
        assert np.mean(size[:, 2] < size[:, :2].min(axis=1)) >= 0.95
    each = np.mean(table[1, :, 2] < table[1, :, :2].min(axis=1), axis=0)
    assert (each[:, 0] >= 0.95).all()  # X alone
    assert ((each[:, 1] > 0.5) & (each[:, 1] < 0.8)).all()  # Y alone: O1 is often as good


def test_claims(result):
    """Every verdict and number is the stated one, also where the paper's claim does not hold here."""
    assert compare(result, TABLE).surprises == []
    assert sum(one.stated_verdict == AGREES for one in PUBLISHED) == 16  # of 24, as the documentation says
    ours = [one for one in defieux2020.CLAIMS if one.study == "defieux2020_table1"]
    assert [text for one in ours if (text := one.stale(result))] == []
