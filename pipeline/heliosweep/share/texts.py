"""Texts of an archive: README, citation and notebook for readers, RO-Crate 1.1 for machines.

The crate is written by hand: the package `rocrate` dates each one by the clock, so that no two have the same bytes, and
brings requests, arcp, python-dateutil and click.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any
from urllib.parse import quote

import yaml

from heliosweep.config.blocks import Creator
from heliosweep.share.described import NOBODY, Column, Described

_SPECIAL = re.compile(r"([|\\])")
#: Name of the description in its archive.
METADATA = "ro-crate-metadata.json"

#: The second one names what schema.org has learned since.
_CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]
_TYPES = {
    ".nc": "application/x-netcdf",
    ".yaml": "application/yaml",
    ".json": "application/json",
    ".md": "text/markdown",
    ".cff": "application/yaml",
    ".ipynb": "application/x-ipynb+json",
    ".csv": "text/csv",
    ".png": "image/png",
    ".tif": "image/tiff",
    ".tiff": "image/tiff",
    ".fits": "application/fits",
    ".npy": "application/octet-stream",
}
_NAMES = {
    "study.yaml": "The study: every parameter of the computation",
    "manifest.json": "Versions and digests of the result and its parts",
    "README.md": "What this is, how to open, cite, verify and rerun it",
    "LICENSE": "What is allowed",
    "CITATION.cff": "How to cite",
    "open.ipynb": "A notebook that opens the data",
    "SHA256SUMS": "Checksums of all files",
}
#: Code of the notebook.
_MEANINGS = """\
for name, values in data.data_vars.items():
    units = values.attrs.get("units", "")
    print(f"{name} [{units}] {tuple(values.dims)}: {values.attrs['long_name']}")"""


def readme(described: Described) -> str:
    """README.md: what this is, how to open, cite, verify and rerun it."""
    opening = "xr.open_zarr" if described.result.endswith(".zarr") else "xr.open_dataset"
    again = "heliosweep compare . again" if described.result.endswith(".zarr") else "cmp result.nc again/result.nc"
    commit = described.manifest.get("environment", {}).get("commit")
    code = f"heliosweep {described.software}" + (f" (commit {commit})" if commit else "")
    sizes = ", ".join(f"{name} {size}" for name, size in described.sizes.items()) or "none"
    inputs = "".join(f"- `{name}`: input of the study, `{key}`\n" for name, key in described.inputs.items())
    return f"""# {described.title}

{described.summary}

## Files

- `{described.result}`: the data, {_format(described)}
- `study.yaml`: the study that they are the result of, with every parameter written out
{inputs}- `manifest.json`: versions and digests of the result and its parts
- `SHA256SUMS`: checksums of all files
- `ro-crate-metadata.json`: this description for machines (RO-Crate 1.1)
- `CITATION.cff`, `LICENSE`: how to cite, and what is allowed
- `open.ipynb`: a notebook that opens the data

## Open

```python
import xarray as xr

data = {opening}("{described.result}")
```

`ncdump -h` and `data.info()` show the same documentation as the tables below. Missing values are NaN.

Dimensions: {sizes}.

### Variables

{_table(described.data)}

### Coordinates

{_table(described.coordinates)}

## Cite

{described.citation}

Licence: {described.licence.name}{f" <{described.licence.url}>" if described.licence.url else ""}. See `LICENSE`.

{_references(described)}## Verify

```sh
sha256sum -c SHA256SUMS
heliosweep verify .
```

## Rerun

Computed with {code}. The same version of it and of its libraries (`manifest.json`) gives the same bytes:

```sh
heliosweep run study.yaml --output again
{again}
```

Study id: `{described.study_id}`; family: `{described.study.family}`; computed: {described.finished}.
"""


def citation(described: Described) -> str:
    """CITATION.cff of the data set."""
    content: dict[str, Any] = {
        "cff-version": "1.2.0",
        "message": "If you use this data set, please cite it as below.",
        "type": "dataset",
        "title": described.title,
        "abstract": described.summary,
        "authors": [_author(creator) for creator in described.creators] or [{"name": NOBODY}],
        "date-released": described.finished[:10],
        "keywords": described.keywords,
    }
    if described.doi:
        content["doi"] = described.doi
    else:
        content["identifiers"] = [
            {"type": "other", "value": described.study_id, "description": "identifier of the study"}
        ]
    if described.licence.spdx:
        content["license"] = described.licence.spdx
    content["references"] = [
        {
            "type": "software",
            "title": "heliosweep",
            "version": described.software,
            "authors": [{"name": "The heliosweep developers"}],
        }
    ]
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120)


def _author(creator: Any) -> dict[str, str]:
    family, comma, given = creator.name.partition(", ")
    author = {"family-names": family, "given-names": given} if comma else {"name": creator.name}
    if creator.affiliation and comma:
        author["affiliation"] = creator.affiliation
    if creator.email:
        author["email"] = creator.email
    if creator.orcid:
        author["orcid"] = f"https://orcid.org/{creator.orcid}"
    return author


def _format(described: Described) -> str:
    conventions = described.attributes.get("Conventions", "")
    return f"{'Zarr version 2' if described.result.endswith('.zarr') else 'NetCDF-4'} ({conventions})"


def _references(described: Described) -> str:
    texts = [text for text in str(described.attributes.get("references", "")).split("; ") if text]
    return "## References\n\n" + "".join(f"- {text}\n" for text in texts) + "\n" if texts else ""


def _table(columns: Sequence[Column]) -> str:
    rows = [(f"`{c.name}`", ", ".join(c.dims), c.units, c.meaning) for c in columns]
    lines = [("name", "dimensions", "units", "meaning"), ("---",) * 4, *rows]
    return "\n".join(
        "| " + " | ".join(_SPECIAL.sub(r"\\\1", " ".join(cell.split())) for cell in row) + " |" for row in lines
    )


def notebook(described: Described) -> str:
    """open.ipynb, format 4.5, without outputs."""
    opening = "xr.open_zarr" if described.result.endswith(".zarr") else "xr.open_dataset"
    first = described.data[0].name
    look = f'data["{first}"]'
    if described.data[0].dims:
        look += f'.isel({{dim: slice(0, 5) for dim in data["{first}"].dims}}).to_series().head(20)'
    needs = "zarr" if described.result.endswith(".zarr") else "netCDF4"
    cells = [
        _cell("markdown", f"# {described.title}\n\n{described.summary}\n\nNeeds xarray and {needs}."),
        _cell("code", f'import xarray as xr\n\ndata = {opening}("{described.result}")\ndata'),
        _cell("markdown", "What each variable means:"),
        _cell("code", _MEANINGS),
        _cell("markdown", f"The values of `{first}`, as a table:"),
        _cell("code", look),
    ]
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    content = {
        "cells": cells,
        "metadata": {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        },
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(content, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def _cell(kind: str, text: str) -> dict[str, Any]:
    cell: dict[str, Any] = {"cell_type": kind, "metadata": {}, "source": text.splitlines(keepends=True)}
    return cell | {"execution_count": None, "outputs": []} if kind == "code" else cell


def crate(described: Described, digests: Mapping[str, str], sizes: Mapping[str, int]) -> str:
    """ro-crate-metadata.json.

    Parameters
    ----------
    described : Described
        The data set.
    digests, sizes : mapping
        SHA-256 and size of each file in the archive, by name. [bytes]
    """
    stored = f"{described.result}/" if described.result.endswith(".zarr") else described.result
    names = [name for name in digests if not name.startswith(f"{described.result}/")]
    parts = [*([stored] if stored.endswith("/") else []), *names, "SHA256SUMS"]
    people, organizations = _people(described)
    graph = [
        {
            "@id": METADATA,
            "@type": "CreativeWork",
            "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
            "about": {"@id": "./"},
        },
        {
            "@id": "./",
            "@type": "Dataset",
            "name": described.title,
            "description": described.summary,
            "datePublished": described.finished[:10],
            "keywords": ", ".join(described.keywords),
            "identifier": f"https://doi.org/{described.doi}" if described.doi else described.study_id,
            "license": {"@id": _licence_id(described)},
            "creator": _linked(person["@id"] for person in people),
            "author": _linked(person["@id"] for person in people),
            "publisher": {"@id": (organizations or people)[0]["@id"]},
            "hasPart": _linked(map(_id, parts)),
            "mentions": {"@id": "#run"},
            "variableMeasured": ", ".join(column.name for column in described.data),
        },
        *([_zarr(described, stored)] if stored.endswith("/") else []),
        *(_file(described, name, digests.get(name), sizes.get(name)) for name in (*names, "SHA256SUMS")),
        {
            "@id": "#run",
            "@type": "CreateAction",
            "name": f"heliosweep run of study {described.study_id}",
            "endTime": described.finished,
            "instrument": {"@id": "#heliosweep"},
            "object": _linked(map(_id, ("study.yaml", *described.inputs))),
            "result": {"@id": _id(stored)},
        },
        _software(described),
        _licence(described),
        *people,
        *organizations,
    ]
    return json.dumps({"@context": _CONTEXT, "@graph": graph}, indent=2, ensure_ascii=False) + "\n"


def _linked(ids: Iterable[str]) -> Any:
    """References to entities; to a single one without a list."""
    links = [{"@id": each} for each in ids]
    return links[0] if len(links) == 1 else links


def _id(name: str) -> str:
    """Address of a file in the crate."""
    return quote(name, safe="/-_.~")


def _file(described: Described, name: str, digest: str | None, size: int | None) -> dict[str, Any]:
    suffix = f".{name.rpartition('.')[2].lower()}" if "." in name else ""
    entity: dict[str, Any] = {"@id": _id(name), "@type": "File"}
    if name == described.result:
        entity |= {"name": "The data", "description": described.summary}
    elif name in described.inputs:
        entity["name"] = f"Input of the study: {described.inputs[name]}"
    else:
        entity["name"] = _NAMES.get(name, name)
    entity["encodingFormat"] = _TYPES.get(suffix, "text/plain")
    if digest is not None:
        entity |= {"contentSize": str(size), "sha256": digest}
    return entity


def _zarr(described: Described, stored: str) -> dict[str, Any]:
    return {
        "@id": stored,
        "@type": "Dataset",
        "name": "The data, Zarr version 2",
        "description": described.summary,
        "encodingFormat": "application/vnd+zarr",
    }


def _software(described: Described) -> dict[str, Any]:
    entity: dict[str, Any] = {
        "@id": "#heliosweep",
        "@type": "SoftwareApplication",
        "name": "heliosweep",
        "version": described.software,
        "description": "Batch studies of solar-concentrator tracking and optics",
    }
    if commit := described.manifest.get("environment", {}).get("commit"):
        entity["identifier"] = f"commit {commit}"
    return entity


def _licence_id(described: Described) -> str:
    return described.licence.url or "LICENSE"


def _licence(described: Described) -> dict[str, Any]:
    entity = {"@id": _licence_id(described), "@type": "CreativeWork", "name": described.licence.name}
    if described.licence.spdx:
        entity["identifier"] = described.licence.spdx
    return entity | {"description": described.licence.notice(described.title, described.people)}


def _people(described: Described) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Creators, and the organizations that they belong to."""
    if not described.creators:
        return [{"@id": "#authors", "@type": "Organization", "name": NOBODY}], []
    names = dict.fromkeys(creator.affiliation for creator in described.creators if creator.affiliation)
    ids = {name: f"#organization-{number}" for number, name in enumerate(names, 1)}
    people = [_person(creator, number, ids) for number, creator in enumerate(described.creators, 1)]
    return people, [{"@id": place, "@type": "Organization", "name": name} for name, place in ids.items()]


def _person(creator: Creator, number: int, organizations: Mapping[str, str]) -> dict[str, Any]:
    place = f"https://orcid.org/{creator.orcid}" if creator.orcid else f"#creator-{number}"
    person: dict[str, Any] = {"@id": place, "@type": "Person", "name": creator.name}
    if creator.affiliation:
        person["affiliation"] = {"@id": organizations[creator.affiliation]}
    if creator.email:
        person["email"] = creator.email
    return person
