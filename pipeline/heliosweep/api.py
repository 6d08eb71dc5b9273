"""From a study to its result: load, plan, build, run, status, report."""

from __future__ import annotations

import glob
import logging
import os
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from heliosweep.config.layers import execution_keys
from heliosweep.config.load import load as load_file
from heliosweep.config.load import load_mapping, validated
from heliosweep.config.study import Study
from heliosweep.errors import FORCE, HeliosweepError, Problem, RunInterrupted, StudyError, reason_of
from heliosweep.families.family import Family, families, family_of_result, study_classes
from heliosweep.families.searched import Searched, searched
from heliosweep.files import remove_leftovers, user_path
from heliosweep.results import Result, result_folder
from heliosweep.store.folder import OUTPUTS

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.execution import Execution
    from heliosweep.grid.plan import Plan
    from heliosweep.runs.run import Run
    from heliosweep.runs.status import Status

log = logging.getLogger("heliosweep")

#: What a study is loaded from: a study file, its content as a mapping, or a study that is changed.
Source: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | Study


def load(source: Source, changes: Mapping[str, Any] | None = None, *, named: str = "") -> Study:
    """Load and check a study.

    Parameters
    ----------
    source : path, mapping or Study
        A study file, the same content as a mapping, or a study, of which `changes` make another one.
    changes : mapping of str to object, optional
        Values by dotted key in place of those of the study, such as ``{"receiver.height": 90}``; None takes a key
        away.
    named : str
        What messages call the place of `changes`.

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
    """Return a study, loaded where it is not yet."""
    return study if isinstance(study, Study) else load(study)


def family_of(study: Study) -> Family:
    """Family that a study belongs to."""
    family = families()[study.family].of_draws(study.sample is not None)
    return family if study.search is None else searched(family)


def plan(study: Source, output: str | os.PathLike[str] | None = None, *, timed: bool = False) -> Plan:
    """Estimate the cost of a study and how it is split into parts. Does not connect to a scheduler.

    Parameters
    ----------
    study : Study, path or mapping
        From `load`, or what `load` takes.
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
    found, family = _planned(study, output, connect=False), family_of(study)
    if not timed:
        return found
    from heliosweep.grid.lazy import Work
    from heliosweep.grid.trial import trial_seconds

    tried, of = found, study
    if isinstance(family, Searched):
        of = family.first(study)
        tried, family = _planned(of, output, connect=False), family.family
    seconds = trial_seconds(Work(family, of, tried.variables, tried.workload.sizes), tried)
    points = found.workload.points / tried.workload.points
    return found if seconds is None else replace(found, seconds=seconds * points)


def _planned(study: Study, output: str | os.PathLike[str] | None, *, connect: bool) -> Plan:
    """Plan of a study; `connect` says whether a scheduler that it names is asked for its workers."""
    from heliosweep.grid.machine import machine_limits
    from heliosweep.grid.plan import make_plan
    from heliosweep.store.parts import WORKING

    execution, folder = study.execution.resolved(), result_folder(study, output)
    try:
        elsewhere = _workers_elsewhere(execution, connect=connect)
    except StudyError as error:
        written = execution.scheduler in repr(study.source.data.get("execution"))  # and not asked for otherwise
        raise (_located(error, study) if written else error) from None
    limits = machine_limits(elsewhere or execution.workers, execution.memory, folder)
    where: Any = "processes" if execution.scheduler in ("processes", "distributed") else "here"
    with suppress(OSError):  # what is there already takes no more; another run may be at work in it
        there = sum(file.stat().st_size for file in (folder / WORKING).glob("*"))
        limits = replace(limits, disk=limits.disk + there)
    family = family_of(study)
    if isinstance(family, Searched):  # a generation has to fit, and tells what the others cost
        return family.plan(study, _planned(family.first(study), folder, connect=connect))
    workload, variables = family.workload(study), family.variables(study)
    try:
        return make_plan(
            workload,
            variables,
            limits,
            execution.chunks,
            where="elsewhere" if elsewhere else where,
            copies=2,  # the parts stay on the disk until the result that is made of them is whole
        )
    except StudyError as error:  # the plan knows keys, not where they stand
        raise _located(error, study) from None


def _located(error: StudyError, study: Study) -> StudyError:
    """The same problems where their keys stand in the study file."""
    return StudyError(
        problem if problem.file else study.problem(problem.key, problem.message) for problem in error.problems
    )


def _workers_elsewhere(execution: Execution, *, connect: bool) -> int | None:
    """How many workers there are that are not of this machine; None where they are."""
    if execution.scheduler in ("synchronous", "threads", "processes", "distributed"):
        return None
    from heliosweep.runs.cluster import worker_count

    return worker_count(execution, connect=connect)


def build(study: Source) -> xr.Dataset:
    """Lazy data set of the whole result: computed with dask when its values are asked for.

    Parameters
    ----------
    study : Study, path or mapping
        From `load`, or what `load` takes.

    Returns
    -------
    xarray.Dataset
        With the attributes of a result, and ``.heliosweep``: see `heliosweep.accessor`.
    """
    study = _loaded(study)
    if study.search is not None:
        raise StudyError(study.problem("search", "has no result before it is run: which points it asks for follows"))
    import heliosweep.accessor  # noqa: F401  (registers with xarray)
    from heliosweep.grid import lazy
    from heliosweep.grid.lazy import Work
    from heliosweep.store.manifest import attributes_of, words_of

    planned, family = plan(study), family_of(study)
    coordinates = family.coordinates(study)
    work = Work(family, study, planned.variables, planned.workload.sizes)
    return lazy.build(work, planned, coordinates).assign_attrs(attributes_of(words_of(family, study), coordinates))


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

    What an earlier run of the same study has computed is not computed again: a finished result is found and left as
    it is, and an interrupted run goes on with the parts that are missing.

    Parameters
    ----------
    study : Study, path or mapping
        From `load`, or what `load` takes.
    output : path, optional
        Result folder; by default ``outputs/<name>-<study id>``.
    scheduler, workers, memory
        As the keys of `execution` in the study file, which they replace. No number of the result depends on them.
    progress : bool
        Whether to show progress on standard error.
    report : bool
        Whether to draw figures and write ``report.html``.
    force : bool
        Whether to compute everything anew, whatever is there.

    Returns
    -------
    Result

    Raises
    ------
    PlanError
        Where the study cannot fit.
    StudyError
        Where the folder cannot be written.
    RunInterrupted
        Where the run was stopped; the parts that were done are kept.
    HeliosweepError
        Where the result cannot be written to its end, as on a full disk, or parts of it failed (the others are kept);
        where the folder holds parts that other code has computed; or where the result is complete and its report
        failed.

    Notes
    -----
    The first run on a machine compiles the kernels and says so by a log message. With ``execution.scheduler:
    processes`` or ``distributed``, the workers import the script that calls this: it must do so below ``if __name__
    == "__main__":``. Where another process runs the same study, this one waits for it.
    """
    from heliosweep.grid.machine import check_open_files
    from heliosweep.runs.run import Run
    from heliosweep.runs.signals import uninterrupted
    from heliosweep.store.folder import check_contents, check_locks, claimed, is_tidy, made, refuse_devices

    asked = _loaded(study)
    given = execution_keys({"scheduler": scheduler, "workers": workers, "memory": memory})
    asked = asked.model_copy(update={"execution": asked.execution.resolved().model_copy(update=given)})
    folder = result_folder(asked, output)
    page = folder / "report.html"

    def prepared() -> Run:
        family = family_of(asked)
        if isinstance(family, Searched):
            from heliosweep.runs.search import SearchRun

            plans = [partial(_planned, output=folder, connect=connect) for connect in (True, False)]
            return SearchRun(family, asked, folder, partial(plans[0], asked), plans[1])
        return Run(family, asked, folder, lambda: _planned(asked, folder, connect=True))

    refuse_devices(folder)
    now = prepared()
    # A result that is there needs no disk, no memory, no cluster and no right to write.
    if not force and (not report or page.exists()) and is_tidy(folder) and (found := now.complete()):
        log.info("%s is complete already; %s computes it anew", found, FORCE)
        return Result(found, {})
    if output is None:
        _say_what_changed(asked, folder)
    check_contents(folder, asked, force)
    check_open_files(asked.execution.scheduler)
    with made(folder), claimed(folder):
        remove_leftovers(folder)
        if asked.output.format == "netcdf":
            check_locks(folder)
        before, now = now, prepared()  # another run may have been at work
        if before.study_id != now.study_id:
            raise StudyError(Problem("the files of the study were edited while it waited; run it again"))
        try:
            if report:
                _check_published(now)
            path = now.result(force=force, progress=progress)
            if report and (now.seconds or not page.exists()):
                with now.timed("report"):
                    _report(folder, asked)
        except BaseException as error:
            with uninterrupted():
                now.tidy()
            if isinstance(error, KeyboardInterrupt):
                raise RunInterrupted(f"interrupted: {now.left()}") from None
            raise
    update_index(folder)
    return Result(path, now.seconds)


def status(*of: str | os.PathLike[str]) -> list[Status]:
    """What became of studies.

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
        A study file that is wrong, or a path that is neither.
    """
    from heliosweep.runs.status import result_folders, status_of

    if not of:
        return [status_of(folder) for folder in result_folders(Path(OUTPUTS))]
    return [status_of(folder_of(place)) for place in of]


def folder_of(place: str | os.PathLike[str], *, there: bool = False) -> Path:
    """Result folder that is meant: the folder itself, or where the result of a study file goes by default.

    With `there`, the study must have been run. Raises StudyError.
    """
    path = user_path(place)
    if path.suffix.lower() not in (".yaml", ".yml") or path.is_dir():
        return path
    folder = result_folder(load(path))
    if there and not folder.is_dir():
        raise StudyError(
            Problem(f"was not run yet; to run it: {shlex.join(['heliosweep', 'run', str(place)])}", file=str(place))
        )
    return folder


def report(folder: str | os.PathLike[str], *, vector: Sequence[str] = (), summary: bool = False) -> Path:
    """Draw the figures of a result folder again, write its page, and list it in the index of all studies.

    Parameters
    ----------
    folder : path
        A result folder.
    vector : sequence of {"svg", "pdf"}
        Formats in which figures are saved besides PNG.
    summary : bool
        Whether to write ``summary.html`` instead, which prints on one page.

    Returns
    -------
    pathlib.Path
        The page.

    Raises
    ------
    StudyError
        No result in the folder.
    HeliosweepError
        The result is damaged.
    """
    if summary:
        from heliosweep.report.page import write_summary

        return write_summary(folder, family_of_result)
    page = _report(folder, vector=vector)
    update_index(folder)
    return page


def update_index(folder: str | os.PathLike[str]) -> None:
    """List a result folder in the index of all studies, if there is one."""
    from heliosweep.report.index import update_index
    from heliosweep.runs.status import status_of

    update_index(folder, status_of)


def _report(
    folder: str | os.PathLike[str],
    study: Study | None = None,
    vector: Sequence[str] = (),
) -> Path:
    try:
        from heliosweep.report.page import write_report

        return write_report(folder, family_of_result, study, vector=vector)
    except HeliosweepError:
        raise
    except Exception as error:  # drawing must not make hours of computing look lost
        log.debug("the report failed", exc_info=True)
        what = reason_of(error)
        advice = "please report this error, with what --verbose prints; --no-report leaves the page out"
        if isinstance(error, (OSError, ImportError, MemoryError)):
            advice = f"when that is mended, run: {shlex.join(['heliosweep', 'report', str(folder)])}"
        raise HeliosweepError(f"the result is complete, the report failed ({what}); {advice}") from error


def _check_published(run: Run) -> None:
    """Find out before anything is computed whether the published numbers fit the study."""
    study = run.study
    table = study.report.published
    if table is not None:
        from heliosweep.grid.lazy import without_values
        from heliosweep.report.comparison import locate, read_published

        known = without_values(run.plan, run.coordinates) if study.search is None else build(study)  # that refuses it
        locate(known, read_published(study.resolve(table.file), table.source, table.file))


def _say_what_changed(study: Study, folder: Path) -> None:
    """Tell a user who edited a study why it is another one now."""
    from heliosweep.store.manifest import latest_identity, listed

    if folder.exists():
        return
    others = folder.parent.glob(f"{glob.escape(folder.name.removesuffix(study.study_id))}{'?' * len(study.study_id)}")
    found = latest_identity(others)
    if found:
        place, identity = found
        log.info("a new study: since %s, changed %s", place, listed(identity.get("study"), study.canonical()))
