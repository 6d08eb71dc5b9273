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

TABLE = read_published(STUDIES / "published" / "defieux2020_table1.csv")
PAPER = ("A", "O1", "O2")
NUMBERS = [f"Table 1: {method} {profile}" for method in PAPER for profile in ("clean", "noisy")]
PUBLISHED = [one for one in TABLE.values if one.claim in NUMBERS]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The run of the table's study."""
    folder = tmp_path_factory.mktemp("defieux2020") / "out"
    study = api.load(STUDIES / "defieux2020_table1.yaml", {"execution.memory": "700 MB"})
    return api.run(study, folder, report=False)


@pytest.fixture(scope="module")
def result(run):
    with run.open() as stored:
        return stored.load()


@pytest.fixture(scope="module")
def table(result):
    """Errors over (profile, seed, method, module, axis), without a referential. [%]"""
    result = result.sel(module=[2, 3], referential="none")
    both = [
        result[f"relative_error_{axis}"].transpose("sun_profile", "profile_seed", "slope_method", "module")
        for axis in "xy"
    ]
    assert result["slope_method"].values.tolist() == [*PAPER, "LM"]
    return np.stack(both, axis=-1)


def test_clean_a_and_o1_miss_the_rotation_of_the_field(table):
    """About 15 % on X, sin 8.6 deg; 2 % on Y, where the paper has 0.7 to 2.1."""
    clean = table[0, 0]
    assert clean[:2, :, 0] == pytest.approx(np.full((2, 2), 14.75), abs=0.3)
    assert clean[:2, :, 1] == pytest.approx(np.full((2, 2), 1.95), abs=0.25)


def test_clean_o2_and_lm_are_exact(table):
    """At most 0.02 %, where the paper has 0.5: its optimiser's tolerance."""
    assert table[0, :, 2:].max() < 0.02
    assert (table[0] == table[0, :1]).all()  # nothing of it is random


def test_noisy_o2_is_the_best_of_the_paper_s_methods(table):
    """Without a referential: in every one of 64 seeds by the root mean square of its four errors and by the largest."""
    for reduce in (lambda errors: np.sqrt(np.mean(errors**2, axis=(2, 3))), lambda errors: errors.max(axis=(2, 3))):
        size = reduce(table[1])
        assert np.mean(size[:, 2] < size[:, :2].min(axis=1)) >= 0.95
    both = np.hypot(table[1, ..., 0], table[1, ..., 1])  # X and Y together, each module by itself
    assert np.mean(both[:, 2] < both[:, :2].min(axis=1)) >= 0.95
    each = np.mean(table[1, :, 2] < table[1, :, :2].min(axis=1), axis=0)
    assert (each[:, 0] >= 0.95).all()  # X alone
    assert (each[:, 1] > 0.5).all()  # Y alone: O1 is often as good
    assert (each[:, 1] < 0.8).all()


def test_claims(result):
    """Every verdict and number is the one that the table states, also where the paper's claim does not hold here."""
    assert compare(result, TABLE).surprises == []
    assert sum(one.stated_verdict == AGREES for one in PUBLISHED) == 16  # of 24, as the documentation says
