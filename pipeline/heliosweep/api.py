"""Main functions: load, plan, build, run, status and report studies."""

from __future__ import annotations

import logging
import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from heliosweep.config.load import execution_keys, load_mapping, validated
from heliosweep.config.load import load as load_file
from heliosweep.config.study import Study
from heliosweep.errors import FORCE, HeliosweepError, Problem, RunInterrupted, StudyError, reason_of
from heliosweep.families.family import families, study_classes
from heliosweep.families.lookup import Searched, family_of, family_of_result, searched
from heliosweep.files import remove_leftovers, user_path
from heliosweep.grid.lazy import Work
from heliosweep.results import Result, result_folder
from heliosweep.runs.run import plan_study, timed_plan
from heliosweep.store.folder import OUTPUTS, check_contents, locked, made, result_folders, status_of
from heliosweep.store.manifest import words_of

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.grid.plan import Plan
    from heliosweep.runs.run import Run
    from heliosweep.store.folder import Status

log = logging.getLogger("heliosweep")

#: Source of a study: a study file, its content as a mapping, or a study that is changed.
Source: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | Study


def load(source: Source, changes: Mapping[str, Any] | None = None, *, named: str = "") -> Study:
    """Load and check a study.

    Parameters
    ----------
    source : path, mapping or Study
        A study file, the same content as a mapping, or a study, of which `changes` make another one.
    changes : mapping of str to object, optional
        New values by dotted key, such as ``{"receiver.height": 90}``; None removes a key.
    named : str
        Name of the place of `changes` in messages.

    Returns
    -------
    Study
        Frozen, validated, all defaults resolved.

    Raises
    ------
    StudyError
        With every problem found, each with file, line, column and key.
    """
    if isinstance(source, Study):
        study = validated(source.source, {source.family: type(source)}, changes)
    elif isinstance(source, Mapping):
        study = load_mapping(source, study_classes(), changes)
    else:
        study = load_file(source, study_classes(), changes, named)
    if study.search is not None and (problems := list(searched(families()[study.family]).check(study))):
        raise StudyError(problems)
    return study


def _loaded(study: Source) -> Study:
    """Return a study, loaded if necessary."""
    return study if isinstance(study, Study) else load(study)


def plan(study: Source, output: str | os.PathLike[str] | None = None, *, timed: bool = False) -> Plan:
    """Estimate the cost of a study and its split into chunks.

    Does not connect to a scheduler.

    Parameters
    ----------
    study : Study, path or mapping
        Study, or source as for `load`.
    output : path, optional
        Result folder; its file system gives the free disk.
    timed : bool
        Compute a small region, if that takes a few seconds at most, and extrapolate the time of the study.

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        If the study does not fit on this machine. The message names the dimension to reduce.
    """
    study = _loaded(study)
    folder = result_folder(study, output)
    return timed_plan(study, folder) if timed else plan_study(study, folder)


def build(study: Source) -> xr.Dataset:
    """Return the result as a lazy data set.

    dask computes only the parameter points whose values are used.

    Parameters
    ----------
    study : Study, path or mapping
        Study, or source as for `load`.

    Returns
    -------
    xarray.Dataset
        With the attributes of a result, and ``.heliosweep``: see `heliosweep.accessor`.
    """
    study = _loaded(study)
    if study.search is not None:
        raise StudyError(study.problem("search", "has no result before it is run: its points depend on earlier points"))
    import heliosweep.accessor  # noqa: F401  (registers with xarray)
    from heliosweep.grid import lazy

    planned, family = plan(study), family_of(study)
    coordinates = family.coordinates(study)
    work = Work(family, study, planned.variables, planned.workload.sizes)
    return lazy.build(work, planned, coordinates).assign_attrs(words_of(family, study), **coordinates.attrs)


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
    """Run a study and leave its result folder.

    A finished result of the same study is returned unchanged, and an interrupted run resumes with the missing parts.

    Parameters
    ----------
    study : Study, path or mapping
        Study, or source as for `load`.
    output : path, optional
        Result folder; by default ``outputs/<name>-<study id>``.
    scheduler, workers, memory
        As the keys of `execution` in the study file, which they replace. No number of the result depends on them.
    progress : bool
        Whether to show progress on standard error.
    report : bool
        Whether to draw figures and write ``report.html``.
    force : bool
        Whether to recompute everything.

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
        If the run was stopped; finished parts are kept.
    HeliosweepError
        If the result cannot be written completely, such as on a full disk; if parts failed (the others are kept); if
        the folder has parts of other code; or if the result is complete and its report failed.

    Notes
    -----
    The first run on a machine compiles the kernels and logs a message. With ``execution.scheduler:
    processes`` or ``distributed``, the workers import the script that calls this: it must do so below ``if __name__
    == "__main__":``. If another process runs the same study, this one waits for it.
    """
    study = _loaded(study)
    given = execution_keys({"scheduler": scheduler, "workers": workers, "memory": memory})
    study = study.model_copy(update={"execution": study.execution.model_copy(update=given)})
    folder = result_folder(study, output)
    page = folder / "report.html"
    if not force and (not report or page.exists()) and (found := _run_of(study, folder).complete()):
        log.info("%s is complete; %s computes it again", found, FORCE)
        return Result(found, {})
    check_contents(folder, study, force)
    with made(folder), locked(folder):
        remove_leftovers(folder)
        task = _run_of(study, folder)
        if task.study_id != study.study_id:
            raise StudyError(Problem("the files of the study were edited while it waited; run it again"))
        try:
            if report:
                _check_published(task)
            path = task.result(force=force, progress=progress)
            if report and (task.seconds or not page.exists()):
                with task.timed("report"):
                    _report(folder, study)
        except KeyboardInterrupt:
            raise RunInterrupted(f"interrupted: {task.left()}") from None
    from heliosweep.report.index import update_index

    update_index(folder)
    return Result(path, task.seconds)


def _run_of(study: Study, folder: Path) -> Run:
    """Run of a study or of its search."""
    from heliosweep.runs.run import Run
    from heliosweep.runs.search import SearchRun

    family = family_of(study)
    return SearchRun(family, study, folder) if isinstance(family, Searched) else Run(family, study, folder)


def status(*of: str | os.PathLike[str]) -> list[Status]:
    """Return the state of studies.

    Parameters
    ----------
    *of : path
        Study files or result folders; without any, all result folders in ``outputs``.

    Returns
    -------
    list of Status

    Raises
    ------
    StudyError
        If a study file is invalid, or a path is neither.
    """
    if not of:
        return [status_of(folder) for folder in result_folders(Path(OUTPUTS))]
    return [status_of(folder_of(place)) for place in of]


def folder_of(place: str | os.PathLike[str], *, there: bool = False) -> Path:
    """Return a result folder: the path itself, or the default folder of a study file.

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
    """Draw the figures of a result folder again, write its page, and list it in the index of all studies.

    Parameters
    ----------
    folder : path
        A result folder.
    vector : sequence of {"svg", "pdf"}
        Formats of figures in addition to PNG.
    summary : bool
        Whether to write ``summary.html`` instead, which prints on one page.

    Returns
    -------
    pathlib.Path
        The page.

    Raises
    ------
    StudyError
        If the folder has no result.
    HeliosweepError
        If the result is damaged.
    """
    from heliosweep.report.index import update_index
    from heliosweep.store.read import check_digest, locate

    folder = user_path(folder)
    check_digest(locate(folder))
    page = _report(folder, vector=vector, summary=summary)
    if not summary:
        update_index(folder)
    return page


def _report(folder: Path, study: Study | None = None, **options: Any) -> Path:
    try:
        from heliosweep.report.page import write_report
        from heliosweep.store.read import open_result

        with open_result(folder) as result:
            return write_report(result, folder, family_of_result(result), study, **options)
    except HeliosweepError:
        raise
    except Exception as error:  # a failed figure must not make the result look lost
        log.debug("the report failed", exc_info=True)
        advice = "please report this error, with the output of --verbose; --no-report omits the page"
        if isinstance(error, (OSError, ImportError, MemoryError)):
            advice = f"resolve this, then run: {shlex.join(['heliosweep', 'report', str(folder)])}"
        raise HeliosweepError(f"the result is complete, the report failed ({reason_of(error)}); {advice}") from error


def _check_published(run: Run) -> None:
    """Find out before anything is computed whether the published numbers fit the study."""
    study = run.study
    table = study.report.published
    if table is not None:
        from heliosweep.grid.lazy import without_values
        from heliosweep.report.comparison import locate, read_published

        known = without_values(run.plan, run.coordinates) if study.search is None else build(study)  # that refuses it
        locate(known, read_published(study.resolve(table.file), table.source, table.file))
