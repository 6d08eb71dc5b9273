"""Write results to ``result.nc`` block by block, with global attributes and a manifest.

The bytes of the file depend only on the values and the library versions, because blocks are always written in the same
order. Dask is not used for writing, because its NetCDF files differ between runs.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep import __version__
from heliosweep.config import CivilTime, SolarTime, Study, WeatherTime, id_of
from heliosweep.errors import HeliosweepError
from heliosweep.files import LIBRARY_LOCK, why_not_written, write_whole, written_whole
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.regions import Cut, Piece, Variable, index_of
from heliosweep.lazy import netCDF4, xr
from heliosweep.sources import code_versions, installed
from heliosweep.store.folder import DESCRIPTIONS, MANIFEST, RESULT, STUDIES, manifest_text, read_manifest, result_digest


def words_of(family: Any, study: Study) -> dict[str, Any]:
    """Return the global attributes of a result according to CF-1.11 and ACDD-1.3.

    The attributes contain no clock time, host, user or path, so repeated runs give equal files. Time and platform are
    recorded in the manifest.
    """
    keywords = ("concentrating solar power", "solar tracking", *family.keywords)
    given = study.dataset.keywords if study.dataset else ()
    canonical = study.canonical()
    study_id = id_of(canonical)
    return {
        "Conventions": "CF-1.11, ACDD-1.3",
        "title": study.title or family.title,
        "summary": summary(study.description or family.title, study),
        "keywords": ", ".join(dict.fromkeys((*keywords, *given))),
        "source": f"heliosweep {__version__}, family {study.family}",
        "history": f"computed by heliosweep {__version__} from study {study_id}",
        "processing_level": "computed from a model",
        "references": "; ".join([*family.references, *study.references]),
        "standard_name_vocabulary": "CF Standard Name Table v90",
        "comment": (
            "Each dimension is a swept key of the study or a dimension of the model. The attribute study contains "
            "all keys, with files replaced by the SHA-256 of their contents. Missing values are NaN."
        ),
        **_people(study),
        **dict(_where(study)),
        **_period(study),
        "id": study_id,
        "study_id": study_id,
        "study": json.dumps(canonical, sort_keys=True, ensure_ascii=False),
    }


def _people(study: Study) -> dict[str, str]:
    about = study.dataset
    if about is None:
        return {"product_version": __version__}
    each = {key: dict.fromkeys(getattr(creator, key) or "" for creator in about.creators)
            for key in ("email", "affiliation", "orcid")}  # fmt: skip
    values = {
        "product_version": about.version or __version__,
        # ACDD separates names by commas, but names may contain commas
        "creator_name": "; ".join(creator.name for creator in about.creators),
        "creator_email": "; ".join(filter(None, each["email"])),
        "creator_institution": "; ".join(filter(None, each["affiliation"])),
        "creator_url": " ".join(f"https://orcid.org/{orcid}" for orcid in each["orcid"] if orcid),
        "license": about.license,
        "metadata_link": about.doi and f"https://doi.org/{about.doi}",
        "publisher_name": about.publisher,
        "naming_authority": about.naming_authority,
        "acknowledgement": "; ".join(", ".join(filter(None, (one.funder, one.award))) for one in about.funding),
    }
    return {name: value for name, value in values.items() if value}


def _where(study: Study) -> Iterator[tuple[str, Any]]:
    if getattr(study, "site", None) is None and getattr(study, "sites", None) is None:
        return
    grid = Parameters(study)
    for key, axis, units in (("site.latitude", "lat", "degrees_north"), ("site.longitude", "lon", "degrees_east")):
        values = np.asarray(grid.column(key)[1] if grid.has(key) else np.nan, dtype=float)
        if np.isfinite(values).any():
            yield f"geospatial_{axis}_min", float(np.nanmin(values))
            yield f"geospatial_{axis}_max", float(np.nanmax(values))
            yield f"geospatial_{axis}_units", units


def _period(study: Study) -> dict[str, str]:
    """Return time coverage attributes of a study with civil time. The resolution is the step within a day."""
    time: Any = getattr(study, "time", None)
    if not isinstance(time, CivilTime):
        return {}
    found, seconds = sorted(time.date_list()), round(3600 * getattr(time.window, "step"))  # noqa: B009
    return {
        "time_coverage_start": found[0].isoformat(),
        "time_coverage_end": found[-1].isoformat(),
        "time_coverage_duration": f"P{(found[-1] - found[0]).days + 1}D",
        "time_coverage_resolution": f"PT{seconds}S" if seconds % 60 else f"PT{seconds // 60}M",
    }


def write_manifest(folder: Path, study: Study, result: Path, content: Mapping[str, Any]) -> None:
    """Write ``manifest.json`` and the resolved study. Raises HeliosweepError if a file cannot be written.

    The mapping `content` contains all manifest entries except the command, the environment and the result.
    """
    recorded = {"file": result.name, "bytes": result.stat().st_size, "sha256": result_digest(result)}
    called = Path(sys.argv[0])
    words = ["python", "-m", called.parent.name] if called.name == "__main__.py" else [called.name]
    lock, commit = installed(), None
    packages = "heliosweep numpy numba llvmlite xarray dask pandas netCDF4 pvlib matplotlib"
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    with suppress(OSError, subprocess.SubprocessError):
        commit = subprocess.run(command, capture_output=True, text=True, timeout=5, check=True).stdout.strip() or None
    environment = {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "packages": {name: lock.get(name.lower()) for name in packages.split()},
        "lock": lock,
        "commit": commit,
    }
    record = {"command": [*words, *sys.argv[1:]], "environment": environment, "result": recorded, **content}
    write_whole(folder / STUDIES[0], study.to_yaml(folder))
    write_whole(folder / MANIFEST, manifest_text(record))


def finished(folder: Path) -> tuple[Path | None, dict[str, Any]]:
    """Return the path (or None) and the identity of the finished result in a folder. The result file is not checked."""
    with suppress(HeliosweepError):
        manifest = read_manifest(folder)
        path = folder / manifest["result"]["file"]
        if manifest.get("identity") and path.exists():
            return path, dict(manifest["identity"])
    return None, {}


def identity_of(study: Study, words: Mapping[str, Any], *modules: str) -> dict[str, Any]:
    """Return the inputs that determine the bytes of a study's result.

    The keys ``study_id`` and ``study`` describe the study, and ``code`` contains the versions of the code. The key
    ``output`` describes the stored variables and their format, and ``attributes`` contains the global attributes.
    """
    canonical = study.canonical()
    # the study and the code, which are compared separately, determine these attributes
    following = ("study", "study_id", "id", "history", "source")
    return {
        "study_id": id_of(canonical),
        "study": canonical,
        "code": code_versions(*modules),
        "output": study.output.model_dump(),
        "attributes": {name: value for name, value in words.items() if name not in following},
    }


def changes(before: Any, after: Any, key: str = "") -> list[str]:
    """Return one line for each key that differs in two mappings, such as ``receiver.height: 60 -> 70``."""
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        prefix = f"{key}." if key else ""
        pairs = ((name, before.get(name), after.get(name)) for name in {**after, **before})
        return [line for name, one, two in pairs for line in changes(one, two, f"{prefix}{name}")]
    one, two = (json.loads(json.dumps(value, default=str)) for value in (before, after))  # converts tuples to lists
    return [] if one == two else [f"{key}: {_words(before)} -> {_words(after)}"]


def listed(before: Any, after: Any, most: int = 3) -> str:
    """Return the first `most` differences between two mappings on one line."""
    lines = changes(before, after)
    return "; ".join(lines[:most]) + (f", and {len(lines) - most} more" if len(lines) > most else "")


def _words(value: Any) -> str:
    if value is None:
        return "not given"
    text = ", ".join(f"{n} {_words(e)}" for n, e in value.items()) if isinstance(value, Mapping) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def summary(about: str, study: Study) -> str:
    """Return a line with the subject and period of a study. The period is omitted if the study has no clock."""
    said, time = " ".join(about.split()), getattr(study, "time", None)
    if isinstance(time, SolarTime | CivilTime):
        period = dates(time)
    elif isinstance(time, WeatherTime):
        months = "" if time.months is None else ", ".join(f"{month:g}" for month in time.months.values())
        period = f"{f'months {months}' if months else 'all months'} of the weather file"
    else:
        return said
    return f"{said.rstrip('.')}. Period: {period}."


def dates(time: SolarTime | CivilTime) -> str:
    """Describe the dates, days of the year or solar declinations of a study."""
    if isinstance(time, CivilTime):
        listed = list(map(str, time.date_list()))
        if len(listed) <= 4:
            return ", ".join(listed)
        each = {0: "", 1: ", every day"}.get(time.dates.step, f", every {time.dates.step} days")
        return f"{listed[0]} to {listed[-1]}{each}: {len(listed)} dates"
    declinations = time.declinations()
    values = time.day_numbers() if declinations is None else declinations
    end = "" if len(values) == 1 else "s"
    what = f"day{end} of the year" if declinations is None else f"declination{end} of the sun (\N{DEGREE SIGN})"
    texts = [f"{float(value):.6g}".replace("-", "\N{MINUS SIGN}") for value in values]
    return f"{what} {', '.join(texts)}" if len(texts) <= 4 else f"{len(texts)} {what}, {texts[0]} to {texts[-1]}"


if TYPE_CHECKING:
    from heliosweep.config.blocks import Output

    Blocks = Iterable[tuple[Piece, Mapping[Any, Any]]]  # each maps names to arrays

_TIME_ATTRIBUTES = {"units": "seconds since 1970-01-01T00:00:00Z", "calendar": "standard"}


def write_result(
    blocks: Blocks,
    coordinates: xr.Dataset,
    variables: Mapping[str, Variable],
    sizes: Mapping[str, int],
    cuts: Mapping[str, Cut],
    output: Output,
    folder: Path,
) -> Path:
    """Write the result of a study, replacing an existing result.

    Parameters
    ----------
    blocks : iterable of (Piece, mapping of str to array)
        All blocks of the result in the order of the file, with the values of their variables.
    coordinates : xarray.Dataset
        Coordinates and global attributes of the result, loaded into memory.
    variables : mapping of str to Variable
        Data variables in the order of the result.
    sizes : mapping of str to int
        Dimensions in the order of the result.
    cuts : mapping of str to Cut
        Division of each kind of variable into blocks, which are also the storage chunks of compressed variables.
    output : Output
        Block `output` of the study. It specifies the compression of time series.
    folder : pathlib.Path
        Result folder.

    Returns
    -------
    pathlib.Path
        Path of ``result.nc``.

    Raises
    ------
    HeliosweepError
        If the result cannot be written. An existing result is then kept.
    """
    path = folder / RESULT
    level = 0 if output.compression == "none" else output.compression_level
    chunks = {**sizes, **cuts["series"].block} if level and "series" in cuts else {}
    # If a run is killed after the removal, the folder has no manifest, and the next run starts again.
    with written_whole(path, [folder / name for name in DESCRIPTIONS]) as temporary:
        with LIBRARY_LOCK:
            file = netCDF4.Dataset(temporary.absolute(), "w", format="NETCDF4")
        try:
            with LIBRARY_LOCK:
                _define(file, coordinates, variables, sizes, chunks, level)
            for block, values in blocks:
                for name in values:
                    array = _numbers(np.asarray(values[name]))
                    with LIBRARY_LOCK:
                        file[name][index_of(variables[name].dims, block.region) or ...] = array
            with LIBRARY_LOCK:
                file.close()
        except (OSError, RuntimeError) as error:
            raise HeliosweepError(why_not_written(path, error)) from error
        finally:
            with LIBRARY_LOCK, suppress(OSError, RuntimeError):
                if file.isopen():
                    file.close()  # closing the file writes data, which fails again if the disk is full
    return path


def _define(
    file: netCDF4.Dataset,
    coordinates: xr.Dataset,
    variables: Mapping[str, Variable],
    sizes: Mapping[str, int],
    chunks: Mapping[str, int],
    level: int,
) -> None:
    """Define all variables. If `chunks` is not empty, time series are stored in chunks and compressed at `level`."""
    file.set_auto_maskandscale(False)
    file.set_fill_off()  # each value is written exactly once
    file.setncatts(dict(coordinates.attrs))
    for dim, size in sizes.items():
        file.createDimension(dim, size)
    _write_coordinates(file, coordinates)
    for name, variable in variables.items():
        dtype = np.dtype(np.float64) if variable.dtype.kind == "M" else variable.dtype
        storage: dict[str, Any] = {"contiguous": True}
        if compressed := bool(chunks) and variable.kind == "series":
            storage = {"chunksizes": [chunks[dim] for dim in variable.dims], "compression": "zlib", "complevel": level}
        fill = np.nan if dtype.kind == "f" else False
        target = file.createVariable(name, dtype, variable.dims, fill_value=fill, **storage)
        if compressed:  # each chunk is written once, so a chunk cache would waste 64 MB per variable
            target.set_var_chunk_cache(size=1, nelems=1, preemption=1.0)
        along = [str(label) for label, one in coordinates.variables.items() if {*one.dims} <= {*variable.dims}]
        labels = [label for label in along if label not in sizes]
        target.setncatts({**variable.attrs, "coverage_content_type": "modelResult"})
        target.setncatts(_TIME_ATTRIBUTES if variable.dtype.kind == "M" else {})
        target.setncatts({"coordinates": " ".join(labels)} if labels else {})
    file.sync()


def _write_coordinates(file: netCDF4.Dataset, coordinates: xr.Dataset) -> None:
    for name, coordinate in coordinates.coords.items():
        values, attrs = coordinate.values, dict(coordinate.attrs)
        dims = tuple(map(str, coordinate.dims))
        if values.dtype.kind in "UOT":
            # HDF5 crashes if a file with strings is opened twice and then closed once (netcdf-c, issue 2510).
            encoded = np.strings.encode(values.astype(str), "utf-8")
            values = np.ascontiguousarray(encoded).view("S1").reshape(*encoded.shape, encoded.itemsize)
            dims, attrs = (*dims, f"string{values.shape[-1]}"), {**attrs, "_Encoding": "utf-8"}
            if dims[-1] not in file.dimensions:
                file.createDimension(dims[-1], values.shape[-1])
        elif values.dtype.kind == "M":
            values, attrs = _numbers(values), {**attrs, **_TIME_ATTRIBUTES}
        if values.dtype.kind == "f" and np.isnan(values).any():
            attrs["missing_value"] = values.dtype.type(np.nan)
        target = file.createVariable(str(name), values.dtype, dims, fill_value=False)
        target.set_auto_chartostring(False)
        target.setncatts(attrs)
        target[...] = values


def _numbers(values: np.ndarray) -> np.ndarray:
    """Return times as seconds since 1970, and NaT as NaN. Other values are returned unchanged."""
    if values.dtype.kind != "M":
        return values
    return np.where(np.isnat(values), np.nan, values.astype("datetime64[ns]").astype(np.int64) / 1e9)
