"""README and citation of an archive."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import yaml

from heliosweep.pack.described import NOBODY, Column, Described

_CELL = re.compile(r"([|\\])")


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
        "| " + " | ".join(_CELL.sub(r"\\\1", " ".join(cell.split())) for cell in row) + " |" for row in lines
    )
