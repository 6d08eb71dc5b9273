"""Family of a study or of a result, with its draws or its search."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from heliosweep.families.family import Family, families
from heliosweep.families.sampled import Sampled
from heliosweep.families.searched import found_by, searched

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.study import Study


def family_of(study: Study) -> Family:
    """Return the family of a study, of its draws or of its search."""
    family = families()[study.family]
    if study.sample is not None:
        family = Sampled(family)
    return family if study.search is None else searched(family)


def family_of_result(result: xr.Dataset) -> Family | None:
    """Return the family of a result, of its draws or of its search; None if it is not installed."""
    study = json.loads(result.attrs.get("study", "{}"))
    family = families().get(study.get("family"))
    if family is None:
        return None
    family = family.of_result(result)
    if "sample" in study:
        family = Sampled(family)
    return found_by(family, result) if study.get("search") else family
