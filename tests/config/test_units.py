"""The unit table against astropy."""

import pytest

from heliosweep.config.faults import Invalid
from heliosweep.config.values import _KINDS, parse

NAMES = {"in": "inch", "days": "day", "degC": "deg_C", "1": ""}


def test_against_astropy() -> None:
    units = pytest.importorskip("astropy.units")
    with units.add_enabled_units(units.imperial):
        for kind in _KINDS.values():
            for given in kind.keys() - {"1"}:
                for wanted in kind:
                    oracle = units.Unit(NAMES.get(given, given)).to(NAMES.get(wanted, wanted), 1.7)
                    assert parse(f"1.7 {given}", wanted) == pytest.approx(oracle, rel=1e-14)


def test_decimals_stay_clean() -> None:
    assert parse("38 ft", "m") == 11.5824
    assert parse("30min", "h") == 0.5
    assert parse(" 12 arcmin ", "deg") == 0.2
    assert parse("2 GB", "B") == 2_000_000_000
    assert parse("0.1 deg", "deg") == 0.1


@pytest.mark.parametrize("text", ["", "m", "1 2 m", "1,5 m", "--1 m", "1 m/s", "1e m", "m 1", "1_0 m", "nan m"])
def test_what_is_no_quantity(text: str) -> None:
    with pytest.raises(Invalid):
        parse(text, "m")


@pytest.mark.parametrize("text", ["0.8 GW/m2", "3 kw/m²", "1 mW/m2"])
def test_an_unknown_unit_lists_all_units_of_the_kind(text: str) -> None:
    with pytest.raises(Invalid, match=r"use 'W/m2', 'kW/m2' or 'MW/m2'$"):
        parse(text, "W/m2")
