"""Global attributes of a result: CF-1.11 and ACDD-1.3, and nothing that differs from run to run."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from heliosweep import __version__
from heliosweep.config.study import Study
from heliosweep.grid.parameters import Parameters

#: What every result can be found by.
_KEYWORDS = ("concentrating solar power", "solar tracking")
#: Keys of a site, what ACDD calls the axis, and its units.
_EXTENT = (("site.latitude", "lat", "degrees_north"), ("site.longitude", "lon", "degrees_east"))


def global_attributes(
    study: Study, title: str, references: Sequence[str], keywords: Sequence[str] = ()
) -> dict[str, Any]:
    """What the file says of itself.

    Parameters
    ----------
    study : Study
        The study that was run.
    title : str
        What its family computes, in one line.
    references : sequence of str
        Sources of the family's models.
    keywords : sequence of str
        Those of the family.

    Returns
    -------
    dict of str to str or float
        No clock time, host, user or path; those are in the manifest.
    """
    given = study.dataset.keywords if study.dataset else ()
    attributes: dict[str, Any] = {
        "Conventions": "CF-1.11, ACDD-1.3",
        "title": study.title or title,
        "summary": " ".join((study.description or title).split()),
        "keywords": ", ".join(dict.fromkeys((*_KEYWORDS, *keywords, *given))),
        "source": f"heliosweep {__version__}, family {study.family}",
        "history": f"computed by heliosweep {__version__} from study {study.study_id}",
        "processing_level": "computed from a model",
        "references": "; ".join([*references, *study.references]),
        "standard_name_vocabulary": "CF Standard Name Table v90",
        "comment": (
            "Each dimension is a key of the study that was swept, or what a model ranges over; the attribute study "
            "holds all keys, files by the SHA-256 of what they say. Missing values are NaN."
        ),
        **dict(_people(study)),
        **dict(_where(study)),
        **dict(_when(study)),
        "product_version": __version__,
        "naming_authority": "heliosweep",
        "id": study.study_id,
        "study_id": study.study_id,
        "study": json.dumps(study.canonical(), sort_keys=True, ensure_ascii=False),
    }
    return attributes


def attributes_of(family: Any, study: Study, coordinates: Any) -> dict[str, Any]:
    """Global attributes of a study's result; `coordinates` are those of the family, whose attributes belong to it."""
    return {**global_attributes(study, family.title, family.references, family.keywords), **coordinates.attrs}


def _people(study: Study) -> Iterator[tuple[str, str]]:
    """Who made the data set, and how it may be used, where the study says so."""
    said = study.dataset
    if said is None:
        return
    if said.creators:
        # ACDD separates several by commas, of which names may have one.
        yield "creator_name", "; ".join(creator.name for creator in said.creators)
    for name, key in (("creator_email", "email"), ("creator_institution", "affiliation")):
        if found := [text for creator in said.creators if (text := getattr(creator, key))]:
            yield name, "; ".join(dict.fromkeys(found))
    if found := [creator.orcid for creator in said.creators if creator.orcid]:
        yield "creator_url", " ".join(f"https://orcid.org/{orcid}" for orcid in found)
    if said.license:
        yield "license", said.license
    if said.doi:
        yield "metadata_link", f"https://doi.org/{said.doi}"


def _where(study: Study) -> Iterator[tuple[str, Any]]:
    """Extent of the sites."""
    if getattr(study, "site", None) is None and getattr(study, "sites", None) is None:
        return
    grid = Parameters(study)
    for key, axis, units in _EXTENT:
        values = grid.parameter(key).to_numpy().astype(float) if grid.has(key) else np.array(np.nan)
        if np.isfinite(values).any():
            yield f"geospatial_{axis}_min", float(np.nanmin(values))
            yield f"geospatial_{axis}_max", float(np.nanmax(values))
            yield f"geospatial_{axis}_units", units


def _when(study: Study) -> Iterator[tuple[str, str]]:
    """Dates that are looked at, of a study on the civil clock; the solar clock has none."""
    time: Any = getattr(study, "time", None)
    if not hasattr(time, "date_list"):
        return
    dates = sorted(time.date_list())
    yield "time_coverage_start", dates[0].isoformat()
    yield "time_coverage_end", dates[-1].isoformat()
    yield "time_coverage_duration", f"P{(dates[-1] - dates[0]).days + 1}D"
    if len(dates) > 1:
        yield "time_coverage_resolution", f"P{min((after - before).days for before, after in pairwise(dates))}D"
