"""Functions for notebooks and scripts: studies without a file, comparison pages, efficiency tables."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heliosweep.api import build, folder_of, load
from heliosweep.config.study import Study
from heliosweep.files import user_path
from heliosweep.results import open_result

if TYPE_CHECKING:
    import xarray as xr


def study(family: str, /, **blocks: Any) -> Study:
    """Create a study from keyword arguments.

    Parameters
    ----------
    family : str
        Name of the study family.
    **blocks
        Content of a study file: mappings, numbers, text with units, lists, `sweep`, `logspace`, arrays. File names
        count from the working directory.

    Returns
    -------
    Study
        Frozen, validated, all defaults resolved.

    Raises
    ------
    StudyError
        If the study is invalid; lists every problem with its key.

    Examples
    --------
    >>> heliosweep.study("field_efficiency", site=dict(latitude=heliosweep.sweep(0, 60, step=15)), ...)
    """
    return load({"family": family, **blocks})


def save(study: Study, path: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Save a study as a study file with the same id.

    Parameters
    ----------
    study : Study
        From `study` or `load`.
    path : path
        File to write; appears under its name when it is complete. Files that the study names are named as seen from
        its folder.
    force : bool
        Whether to replace an existing file.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    StudyError
        If the file exists.
    HeliosweepError
        If the file cannot be written.
    """
    from heliosweep.files import write_whole
    from heliosweep.store.folder import sources_of, target_file

    named = sources_of(study) - {study.source.path}  # the study file itself may be saved anew
    file = target_file(path, force, endings=(), sources=named)
    write_whole(file, study.to_yaml(file.parent))
    return file


def comparison_page(
    results: Sequence[str | os.PathLike[str]], page: str | os.PathLike[str], *, force: bool = False
) -> Path:
    """Write one page that compares several results.

    Parameters
    ----------
    results : sequence of path
        Result folders; all are compared with the first.
    page : path
        HTML file to write; appears under its name when it is complete.
    force : bool
        Whether to replace an existing file.

    Returns
    -------
    pathlib.Path
        The page.

    Raises
    ------
    StudyError
        If a folder has no result, or the page cannot be written.
    HeliosweepError
        If a result is damaged.
    """
    from heliosweep.families.lookup import family_of_result
    from heliosweep.report.several import Compared, write_comparison
    from heliosweep.store.folder import target_file
    from heliosweep.store.read import check_digest, locate

    file = target_file(page, force, endings=(".html",), sources=results)
    for place in results:
        check_digest(locate(place))
    with ExitStack() as opened:
        compared = []
        for place in map(user_path, results):
            result = opened.enter_context(open_result(place))
            compared.append(Compared(place, result, family_of_result(result)))
        return write_comparison(compared, file)


def efficiency_table(
    source: Study | str | os.PathLike[str],
    select: Mapping[str, Any] | None = None,
    *,
    azimuth: Any = None,
    elevation: Any = None,
    factor: float = 1.0,
) -> xr.DataArray:
    """Efficiency of a field over sun directions, for SAM and SolarPILOT.

    Parameters
    ----------
    source : Study or path
        A field study, its file, or its result folder. Computed where the source is no result over directions of the
        sun, or other directions are given.
    select : mapping of str to value, optional
        Value of every swept parameter of the field, such as ``{"tracking": "azimuth_elevation"}``.
    azimuth, elevation : number, sequence or mapping, optional
        Directions of the sun, from north, clockwise, and above the horizon; every 15 and 5 deg where the source has
        none. [deg]
    factor : float
        Factors that the table omits, 0 to 1: the absorptance of the receiver, and for a study without `optics` also
        reflectivity, soiling, attenuation and intercept.

    Returns
    -------
    xarray.DataArray
        Over ``sun_elevation`` and ``sun_azimuth``; `write_table` writes it.

    Raises
    ------
    StudyError
        If the study has no field, or a swept parameter without a value.
    """
    from heliosweep.share import sam

    return _at_directions(
        source, select, azimuth, elevation, lambda result, chosen: sam.efficiency_table(result, chosen, factor=factor)
    )


def flux_maps(
    source: Study | str | os.PathLike[str],
    select: Mapping[str, Any] | None = None,
    *,
    azimuth: Any = None,
    elevation: Any = None,
) -> xr.DataArray:
    """Fraction of light on each column of the receiver, for SAM.

    Parameters
    ----------
    source, select, azimuth, elevation
        As for `efficiency_table`; the study has `output.flux_map`.

    Returns
    -------
    xarray.DataArray
        Over ``sun_elevation``, ``sun_azimuth`` and the columns; `write_table` writes it, in the order of the table of
        efficiencies.

    Raises
    ------
    StudyError
        If the study has no flux map, or a swept parameter without a value.
    """
    from heliosweep.share import sam

    return _at_directions(source, select, azimuth, elevation, sam.flux_maps)


def _at_directions(
    source: Any,
    select: Mapping[str, Any] | None,
    azimuth: Any,
    elevation: Any,
    made: Callable[[xr.Dataset, Mapping[str, Any]], xr.DataArray],
) -> Any:
    """Apply a function to a result over directions of the sun: to the source, or to one that is computed.

    If a result has `keep`, only the kept heliostats are computed.
    """
    from heliosweep.share import sam
    from heliosweep.share.fields import kept_field
    from heliosweep.share.selection import dimension_of
    from heliosweep.store.read import check_digest, locate

    asked, kept = azimuth is not None or elevation is not None, None
    if not isinstance(source, Study):
        source = folder_of(source) if folder_of(source).is_dir() else source
    if not isinstance(source, Study) and user_path(source).is_dir():
        check_digest(locate(source))
        with open_result(source) as result:
            if "sun_azimuth" in result.coords and not asked:
                return made(result, select or {})
            if "kept" in result:
                kept = kept_field(result, select)
        source = user_path(source) / "study.resolved.yaml"
    field = source if isinstance(source, Study) else load(source, kept)
    if asked or not sam.is_directed(field):
        field = sam.at_directions(field, azimuth, elevation)
    directed = build(field)
    # Keys of the layout are no dimensions any more if the heliostats that are kept take its place.
    left = {
        key: value for key, value in (select or {}).items() if not kept or dimension_of(directed, key) in directed.dims
    }
    return made(directed, left)
