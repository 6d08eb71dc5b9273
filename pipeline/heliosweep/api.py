"""Main functions to load, plan, build, run and report studies, show their status, and open results."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from heliosweep.config import Study, execution_keys, load_mapping, validated
from heliosweep.config.load import load as load_file
from heliosweep.errors import FORCE, HeliosweepError, Problem, RunInterrupted, StudyError, load_extra, log, reason_of
from heliosweep.families.family import families, study_classes
from heliosweep.families.lookup import Searched, family_of, family_of_result
from heliosweep.files import remove_leftovers, user_path, write_whole
from heliosweep.grid.plan import Plan, Work
from heliosweep.grid.plan import build as build_lazily
from heliosweep.lazy import xr
from heliosweep.runs.run import Run, plan_study, timed_plan
from heliosweep.store import folder as stored
from heliosweep.store.folder import (
    OUTPUTS,
    Status,
    check_contents,
    locked,
    made,
    page_head,
    sources_of,
    status_of,
    target_file,
)
from heliosweep.store.writer import words_of


def result_folder(study: Study, output: str | os.PathLike[str] | None = None) -> Path:
    """Return the result folder of a study (default: ``outputs/<study file name>-<study id>``).

    Raises
    ------
    StudyError
        If `output` is empty or cannot be accessed.
    """
    if output is None:
        name = Path(study.source.path).stem if study.source.path else study.family
        printable = "".join(letter if letter.isprintable() and letter != "\\" else "_" for letter in name)
        return Path(OUTPUTS) / f"{printable}-{study.study_id}"
    if not os.fspath(output):
        raise StudyError(Problem("the name of the result folder is empty"))
    folder = user_path(output)
    try:
        folder.exists()
    except OSError as error:
        problem = f"cannot be accessed: {error.strerror}; choose another folder with --output"
        raise StudyError(Problem(problem, file=str(folder))) from None
    return folder


@dataclass(frozen=True)
class Result:
    """Result folder of a finished run.

    Parameters
    ----------
    path : pathlib.Path
        Path of ``result.nc``. The same folder contains ``manifest.json``, ``study.resolved.yaml``, ``report.html``
        and ``figures/``.
    seconds : dict of str to float
        Duration of each stage of the run; empty if the result already existed. [s]
    """

    path: Path
    seconds: dict[str, float]

    @property
    def folder(self) -> Path:
        """Result folder."""
        return self.path.parent

    @property
    def page(self) -> Path | None:
        """Path of the HTML report, or None if there is no report."""
        page = self.folder / "report.html"
        return page if page.is_file() else None

    def open(self) -> xr.Dataset:
        """Open the result as a data set."""
        return open_result(self.path)

    def summary(self) -> str:
        """Return the title, dimensions, headline numbers and report path, one item per line."""
        from heliosweep.report.tables import summary

        with stored.open_result(self.path) as data:
            family = family_of_result(data)
            lines = [*summary(data, family.headlines if family else ()), *(family.answers(data) if family else ())]
        return "\n".join([*lines, *([f"page: {self.page}"] if self.page else [])])

    def headline(self) -> str:
        """Return the first headline number, or the dimensions if the result has no headline numbers."""
        if not self.seconds and self.page and (headline := page_head(self.page)[1]):
            return headline
        lines = self.summary().splitlines()
        return lines[2 if len(lines) > 2 and not lines[2].startswith("page: ") else 1]

    def ending(self) -> str:
        """Return the summary of a new result, or the headline number and report path of an existing result."""
        if self.seconds or not self.page:
            return self.summary() if self.seconds else ""
        return "\n".join([*filter(None, page_head(self.page)), f"page: {self.page}"])

    def __str__(self) -> str:
        return f"{self.summary()}\ndata: {self.path}"


def open_result(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a result as a lazy data set.

    Results can be opened while other threads run studies.

    Parameters
    ----------
    path : path
        Result folder, or the file ``result.nc`` in a result folder.

    Returns
    -------
    xarray.Dataset
        Data set whose values are read only when they are needed. Close the data set after use, or use it as a context
        manager. The checksum is not verified. Run ``heliosweep verify`` if the file may be damaged. If the layout
        contains unique names, heliostats can be selected by name with ``sel(name="A1")`` or
        ``heliosweep.sel(heliostat="A1")``.

    Raises
    ------
    StudyError
        If the folder has no result.

    Examples
    --------
    >>> import heliosweep
    >>> with heliosweep.open_result("result") as data:
    ...     data.receiver_height.values.tolist()
    [40.0, 60.0]
    """
    import heliosweep.accessor  # noqa: F401  (registers with xarray)

    result = stored.open_result(path)
    names = result.coords.get("name")
    if names is not None and names.ndim == 1 and len(set(names.to_numpy().tolist())) == names.size:
        named = result.set_xindex("name")
        named.set_close(result.close)  # otherwise, closing the new data set would leave the file open
        return named
    return result


#: Source of a study: a study file, its content as a mapping, or an existing study.
Source: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | Study


def load(source: Source, changes: Mapping[str, Any] | None = None, *, named: str = "") -> Study:
    """Load and validate a study.

    Parameters
    ----------
    source : path, mapping or Study
        Study file, its content as a mapping, or an existing study.
    changes : mapping of str to object, optional
        New values for dotted keys, for example ``{"receiver.height": 90}``; None removes a key.
    named : str
        Name for the source of `changes` in error messages.

    Returns
    -------
    Study
        Validated, immutable study with all defaults resolved.

    Raises
    ------
    StudyError
        If the study is invalid. The error lists every problem with file, line, column and key.

    Examples
    --------
    >>> import heliosweep
    >>> study = heliosweep.load("tower.yaml")
    >>> study.family, study.title
    ('field_efficiency', 'Two towers')
    """
    if isinstance(source, Study):
        study = validated(source.source, {source.family: type(source)}, changes)
    elif isinstance(source, Mapping):
        study = load_mapping(source, study_classes(), changes)
    else:
        study = load_file(source, study_classes(), changes, named)
    if study.search is not None and (problems := list(Searched(families()[study.family]).check(study))):
        raise StudyError(problems)
    return study


def plan(study: Source, output: str | os.PathLike[str] | None = None, *, timed: bool = False) -> Plan:
    """Estimate the cost of a study, and divide the study into chunks.

    This function does not connect to a scheduler.

    Parameters
    ----------
    study : Study, path or mapping
        Study, or its source as in `load`.
    output : path, optional
        Result folder. The plan uses the free disk space of its file system.
    timed : bool
        If True, compute a small part of the study and extrapolate its run time, unless this part would take more than a
        few seconds.

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        If the study does not fit on this machine. The message names the dimension to reduce.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.plan("tower.yaml").in_words()["points"]
    '2 parameter combinations'
    """
    study = study if isinstance(study, Study) else load(study)
    folder = result_folder(study, output)
    return timed_plan(study, folder) if timed else plan_study(study, folder)


def build(study: Source) -> xr.Dataset:
    """Return the result of a study as a lazy data set.

    Dask computes each parameter point only when its values are needed.

    Parameters
    ----------
    study : Study, path or mapping
        Study, or its source as in `load`.

    Returns
    -------
    xarray.Dataset
        Lazy result. The accessor ``.heliosweep`` is described in `heliosweep.accessor`.

    Raises
    ------
    StudyError
        If the study is invalid, or if the study contains a search.
    PlanError
        If the study does not fit on this machine.

    Examples
    --------
    >>> import heliosweep
    >>> lazy = heliosweep.build("tower.yaml")
    >>> round(float(lazy.field_optical_efficiency.sel(receiver_height=60)), 3)  # computes this point alone
    0.874
    """
    study = study if isinstance(study, Study) else load(study)
    if study.search is not None:
        raise StudyError(
            study.problem(
                "search", "cannot be built lazily because each point depends on earlier points; run the study instead"
            )
        )
    import heliosweep.accessor  # noqa: F401  (registers with xarray)

    planned, family = plan(study), family_of(study)
    coordinates = family.coordinates(study)
    work = Work(family, study, planned.variables, planned.workload.sizes)
    return build_lazily(work, planned, coordinates).assign_attrs(words_of(family, study), **coordinates.attrs)


def run(
    study: Source,
    output: str | os.PathLike[str] | None = None,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    memory: int | str | None = None,
    progress: bool = False,
    report: bool = True,
    force: bool = False,
) -> Result:
    """Run a study and write its result folder.

    A finished result of the same study is returned unchanged. An interrupted run resumes with the missing parts.

    Parameters
    ----------
    study : Study, path or mapping
        Study, or its source as in `load`.
    output : path, optional
        Result folder; by default ``outputs/<name>-<study id>``.
    scheduler, workers, memory
        Overrides of the `execution` keys in the study file. These keys do not affect the computed values.
    progress : bool
        If True, show progress on standard error.
    report : bool
        If True, draw figures and write ``report.html``.
    force : bool
        If True, recompute everything.

    Returns
    -------
    Result

    Raises
    ------
    PlanError
        If the study does not fit on this machine.
    StudyError
        If the folder cannot be written.
    RunInterrupted
        If the run is stopped. Finished parts are kept.
    HeliosweepError
        If the result cannot be written completely, for example because the disk is full, or if the computation of a
        part fails. Finished parts are kept. The error is also raised if the folder contains parts computed by another
        version of the code, or if the report of a complete result fails.

    Notes
    -----
    The first run on a machine compiles the kernels and logs a message. With ``execution.scheduler: processes`` or
    ``distributed``, the workers import the calling script. The script must therefore call this function below ``if
    __name__ == "__main__":``. If another process is running the same study, this function waits until that run ends.

    Examples
    --------
    >>> import heliosweep
    >>> result = heliosweep.run("tower.yaml", "result", report=False)
    >>> with result.open() as data:
    ...     data.field_optical_efficiency.round(3).values.tolist()
    [0.824, 0.874]
    """
    study = study if isinstance(study, Study) else load(study)
    given = execution_keys({"scheduler": scheduler, "workers": workers, "memory": memory})
    study = study.model_copy(update={"execution": study.execution.model_copy(update=given)})
    folder = result_folder(study, output)
    page = folder / "report.html"
    if not force and (not report or page.exists()) and (found := _run_of(study, folder).complete()):
        log.info("%s is complete; %s recomputes it", found, FORCE)
        return Result(found, {})
    check_contents(folder, study, force)
    with made(folder), locked(folder):
        remove_leftovers(folder)
        task = _run_of(study, folder)
        if task.study_id != study.study_id:
            raise StudyError(Problem("the input files changed while the run was waiting; run the study again"))
        try:
            if report and (table := study.report.published) is not None:  # finds problems in the table before the run
                from heliosweep.report import comparison

                published = comparison.read_published(study.resolve(table.file), table.source, table.file)
                comparison.locate(build(study), published)
            path = task.result(force=force, progress=progress)
            if report and (task.seconds or not page.exists()):
                with task.timed("report"):
                    _report(folder, study)
        except KeyboardInterrupt:
            raise RunInterrupted(f"interrupted: {task.left()}") from None
    _list(folder)
    return Result(path, task.seconds)


def _list(folder: Path) -> None:
    """Update the index of all studies if the result folder is in ``outputs``."""
    if folder.absolute().parent.name == OUTPUTS:
        from heliosweep.report.page import write_index

        try:
            write_index(folder.absolute().parent)
        except (OSError, HeliosweepError) as error:
            log.warning("the index of all studies was not written: %s", error)


def _run_of(study: Study, folder: Path) -> Run:
    family = family_of(study)
    if isinstance(family, Searched):
        from heliosweep.runs.search import SearchRun

        return SearchRun(family, study, folder)
    return Run(family, study, folder)


def status(*of: str | os.PathLike[str]) -> list[Status]:
    """Return the status of studies.

    Parameters
    ----------
    *of : path
        Study files or result folders (default: all result folders in ``outputs``).

    Returns
    -------
    list of Status

    Raises
    ------
    StudyError
        If a study file is invalid, or a path is neither a study file nor a result folder.

    Examples
    --------
    >>> import heliosweep
    >>> [each.state for each in heliosweep.status("result")]
    ['complete']
    """
    if not of:
        return [one for one in map(status_of, sorted(Path(OUTPUTS).glob("*/"))) if one.state != "not run"]
    return [status_of(folder_of(place)) for place in of]


def folder_of(place: str | os.PathLike[str], *, there: bool = False) -> Path:
    """Return the result folder of a study file, or return a result folder unchanged.

    Raises StudyError if `there` is True and the study has not been run.
    """
    path = user_path(place)
    if path.suffix.lower() not in (".yaml", ".yml") or path.is_dir():
        return path
    folder = result_folder(load(path))
    if there and not folder.is_dir():
        raise StudyError(
            Problem(f"has not been run; run: {shlex.join(['heliosweep', 'run', str(place)])}", file=str(place))
        )
    return folder


def report(folder: str | os.PathLike[str], *, vector: Sequence[str] = (), summary: bool = False) -> Path:
    """Redraw the figures of a result and write its HTML report.

    Unless `summary` is True, the index of all studies is also updated.

    Parameters
    ----------
    folder : path
        Result folder.
    vector : sequence of {"svg", "pdf"}
        Figure formats in addition to PNG.
    summary : bool
        If True, write ``summary.html``, which fits on one printed page, instead of ``report.html``.

    Returns
    -------
    pathlib.Path
        Path of the HTML file.

    Raises
    ------
    StudyError
        If the folder has no result.
    HeliosweepError
        If the result is damaged.
    """
    folder = user_path(folder)
    stored.check_digest(stored.locate(folder))
    page = _report(folder, vector=vector, summary=summary)
    if not summary:
        _list(folder)
    return page


def _report(folder: Path, study: Study | None = None, **options: Any) -> Path:
    try:
        from heliosweep.report.page import write_report

        with stored.open_result(folder) as result:
            return write_report(result, folder, family_of_result(result), study, **options)
    except HeliosweepError:
        raise
    except Exception as error:  # the message states that the result is complete
        log.debug("the report failed", exc_info=True)
        advice = "please report this error and include the output of --verbose; --no-report omits the page"
        if isinstance(error, (OSError, ImportError, MemoryError)):
            advice = f"fix this, then run: {shlex.join(['heliosweep', 'report', str(folder)])}"
        raise HeliosweepError(
            f"the result is complete, but the report failed ({reason_of(error)}); {advice}"
        ) from error


def study(family: str, /, **blocks: Any) -> Study:
    """Create a study from keyword arguments.

    Parameters
    ----------
    family : str
        Name of the study family.
    **blocks
        Content of a study file: mappings, numbers, strings with units, lists, `sweep`, `logspace` and arrays. File
        names are relative to the working directory.

    Returns
    -------
    Study
        Validated, immutable study with all defaults resolved.

    Raises
    ------
    StudyError
        If the study is invalid. The message lists every problem with its key.

    Examples
    --------
    >>> import heliosweep
    >>> study = heliosweep.study(
    ...     "dish_tracking", title="Tilts", site={"latitude": 40, "longitude": 95},
    ...     time={"clock": "civil", "timezone": "+08:00", "dates": ["2021-06-21"],
    ...           "window": {"start": "07:00", "stop": "21:00", "step": "30 min"}},
    ...     mount={"model": "rigid"}, errors={"axis_tilt": heliosweep.sweep(0, 0.2, num=3)}, tolerance=4,
    ... )
    >>> study.title
    'Tilts'
    """
    return load({"family": family, **blocks})


def save(study: Study, path: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Write a study to a study file. The study id does not change.

    Parameters
    ----------
    study : Study
        Study to save.
    path : path
        File to write. The file is created atomically, when its content is complete. File names in the study become
        relative to the folder of this file.
    force : bool
        If True, replace an existing file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    StudyError
        If the file exists.
    HeliosweepError
        If the file cannot be written.

    Examples
    --------
    >>> import heliosweep
    >>> study = heliosweep.load("tower.yaml").with_({"receiver.height": 50.0})
    >>> heliosweep.save(study, "lower.yaml").name
    'lower.yaml'
    """
    named = sources_of(study) - {study.source.path}  # the study file itself may be overwritten
    file = target_file(path, force, endings=(), sources=named)
    write_whole(file, study.to_yaml(file.parent))
    return file


def comparison_page(
    results: Sequence[str | os.PathLike[str]], page: str | os.PathLike[str], *, force: bool = False
) -> Path:
    """Write an HTML page that compares several results.

    Parameters
    ----------
    results : sequence of path
        Result folders. The first result is the reference for the comparison.
    page : path
        HTML file to write. The file is created atomically, when its content is complete.
    force : bool
        If True, replace an existing file.

    Returns
    -------
    pathlib.Path
        Path of the page.

    Raises
    ------
    StudyError
        If a folder has no result, or the page cannot be written.
    HeliosweepError
        If a result is damaged.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.comparison_page(["result", "other"], "comparison.html").name
    'comparison.html'
    """
    from heliosweep.report.page import write_comparison

    file = target_file(page, force, endings=(".html",), sources=results)
    for place in results:
        stored.check_digest(stored.locate(place))
    with ExitStack() as opened:
        compared = []
        for place in map(user_path, results):
            result = opened.enter_context(open_result(place))
            compared.append((place, result, family_of_result(result)))
        return write_comparison(compared, file)


def efficiency_table(
    source: Study | str | os.PathLike[str],
    select: Mapping[str, Any] | None = None,
    *,
    azimuth: Any = None,
    elevation: Any = None,
    factor: float = 1.0,
) -> xr.DataArray:
    """Return the field efficiency as a function of sun direction, for SAM and SolarPILOT.

    Parameters
    ----------
    source : Study or path
        Field study, study file, or result folder. The efficiency is recomputed if the source is not a result over sun
        directions, or if `azimuth` or `elevation` is given.
    select : mapping of str to value, optional
        Value of every swept parameter of the field, for example ``{"tracking": "azimuth_elevation"}``.
    azimuth, elevation : number, sequence or mapping, optional
        Azimuths (clockwise from north) and elevations of the sun. By default, the directions of the source are used. If
        the source has no directions, the steps are 15 deg in azimuth and 5 deg in elevation. [deg]
    factor : float
        Product of the efficiency factors that the study does not compute, from 0 to 1. These factors are the
        absorptance of the receiver and, for a study without `optics`, also reflectivity, soiling, attenuation and
        intercept. [1]

    Returns
    -------
    xarray.DataArray
        Efficiency with the dimensions ``sun_elevation`` and ``sun_azimuth``, for use with `write_table`.

    Raises
    ------
    StudyError
        If the study has no field, or if no value is given for a swept parameter.

    Examples
    --------
    >>> import heliosweep
    >>> table = heliosweep.efficiency_table("one_tower.yaml", azimuth=[90.0, 180.0], elevation=[20.0, 60.0])
    >>> table.sizes["sun_azimuth"], table.sizes["sun_elevation"]
    (2, 2)
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
    """Return the fraction of the light on each column of the receiver, for SAM.

    Parameters
    ----------
    source, select, azimuth, elevation
        As in `efficiency_table`. The study must contain the `output.flux_map` key.

    Returns
    -------
    xarray.DataArray
        Fractions with the dimensions ``sun_elevation``, ``sun_azimuth`` and ``flux_column``, for use with
        `write_table`. The sun directions are in the same order as in the efficiency table. [1]

    Raises
    ------
    StudyError
        If the study has no flux map, or if no value is given for a swept parameter.

    Examples
    --------
    >>> import heliosweep
    >>> maps = heliosweep.flux_maps("cylinder.yaml", azimuth=[180.0], elevation=[45.0])
    >>> maps.dims
    ('sun_elevation', 'sun_azimuth', 'flux_column')
    """
    from heliosweep.share import sam

    return _at_directions(source, select, azimuth, elevation, sam.flux_maps)


def plant_electricity(
    source: str | os.PathLike[str], select: Mapping[str, Any] | None = None, inputs: Mapping[str, Any] | None = None
) -> xr.Dataset:
    """Compute the electricity generated by a plant with SAM's molten-salt power tower.

    The weather file of the study provides the weather data.

    Parameters
    ----------
    source : path
        Study file with a field, a cylindrical receiver and a weather file, or the result folder of such a study.
    select : mapping of str to value, optional
        Value of every swept parameter.
    inputs : mapping of str to value, optional
        Inputs of ``PySAM.TcsmoltenSalt`` that override values from the study and SAM's defaults.

    Returns
    -------
    xarray.Dataset
        Result of `tower_electricity` with local times, and the variables `field_receiver_energy` and `field_heat` from
        the study [MWh].

    Raises
    ------
    StudyError
        If SAM cannot model the plant, or if no value is given for a swept parameter.
    HeliosweepError
        If PySAM is not installed, or SAM rejects an input.

    Examples
    --------
    >>> import heliosweep
    >>> year = heliosweep.plant_electricity("plant", inputs={"tshours": 12})
    >>> year.electric_power.sizes["time"]
    8760
    """
    from heliosweep.share import fields, sam

    load_extra(*sam.EXTRA)
    folder = folder_of(source, there=True)
    study = load(folder / "study.resolved.yaml")
    sun = ({"start": 0, "stop": 360, "step": 30}, {"start": 5, "stop": 85, "step": 10})

    def chosen(result: xr.Dataset, left: Mapping[str, Any]) -> xr.Dataset:
        swept, field = {dim.name for dim in study.dimensions()}, result[sam.FIELD]
        return fields.chosen(field, left, [str(dim) for dim in field.dims if dim not in swept]).compute()

    with open_result(folder) as result:
        return sam.electricity_of(
            study, result, select or {}, inputs or {},
            lambda: _at_directions(folder, select, *sun, chosen, sam.OUTPUT),
        )  # fmt: skip


def _at_directions(
    source: Any,
    select: Mapping[str, Any] | None,
    azimuth: Any,
    elevation: Any,
    made: Callable[[xr.Dataset, Mapping[str, Any]], Any],
    changes: Mapping[str, Any] | None = None,
) -> Any:
    """Apply the function `made` to a result over sun directions.

    If the source is not a result over sun directions, this result is computed first. If the study sets `keep`, only the
    kept heliostats are simulated. If the source is a result folder, `changes` are applied to its study.
    """
    from heliosweep.share import sam
    from heliosweep.share.fields import dimension_of, kept_field

    asked, kept = azimuth is not None or elevation is not None, dict[str, Any]()
    if not isinstance(source, Study) and (folder := folder_of(source)).is_dir():
        stored.check_digest(stored.locate(folder))
        with open_result(folder) as result:
            if "sun_azimuth" in result.coords and not asked:
                return made(result, select or {})
            if "kept" in result or "aim_x" in result.data_vars:
                kept = kept_field(result, select)
        source = folder / "study.resolved.yaml"
    field = source if isinstance(source, Study) else load(source, {**kept, **(changes or {})})
    if asked or getattr(getattr(field, "time", None), "clock", "") != "sun":
        field = sam.at_directions(field, azimuth, elevation)
    directed = build(field)
    # If the kept heliostats replace the layout, layout keys are no longer dimensions.
    left = {
        key: value for key, value in (select or {}).items() if not kept or dimension_of(directed, key) in directed.dims
    }
    return made(directed, left)
