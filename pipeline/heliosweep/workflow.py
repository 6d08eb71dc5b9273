"""From a study file to a result folder: load, plan, build, run, open.

These five functions are the library's public face; the command line calls nothing else.
"""

from __future__ import annotations

import logging
import os
import shlex
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heliosweep.config.load import load as load_file
from heliosweep.config.load import load_mapping
from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError, Problem, RunInterrupted, StudyError
from heliosweep.families.registry import Family, families, study_classes

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.grid.plan import Plan

log = logging.getLogger("heliosweep")

#: Where results go when nobody says: below the working directory.
OUTPUTS = "outputs"


def load(source: str | os.PathLike[str] | Mapping[str, Any]) -> Study:
    """Load and check a study.

    Parameters
    ----------
    source : path or mapping
        A study file, or the same content as a mapping.

    Returns
    -------
    Study
        Frozen, validated, all defaults resolved.

    Raises
    ------
    StudyError
        With every problem found, each with file, line, column and key.
    """
    classes = study_classes()
    return load_mapping(source, classes) if isinstance(source, Mapping) else load_file(source, classes)


def family_of(study: Study) -> Family[Any]:
    """Family that a study belongs to."""
    return families()[study.family]


def plan(study: Study, output: str | os.PathLike[str] | None = None) -> Plan:
    """What a study will cost and how it will be cut.

    Parameters
    ----------
    study : Study
        From `load`.
    output : path, optional
        Where the result would go; tells the free disk.

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        Where the study cannot fit this machine; names the axis to shrink.
    """
    from heliosweep.grid.limits import machine_limits
    from heliosweep.grid.plan import make_plan

    execution = study.execution
    limits = machine_limits(execution.workers, execution.memory, output or result_folder(study))
    processes = execution.scheduler == "processes"
    return make_plan(family_of(study).workload(study), limits, execution.chunks, processes=processes)


def build(study: Study) -> xr.Dataset:
    """Lazy data set of the whole result: computed with dask when its values are asked for.

    Parameters
    ----------
    study : Study
        From `load`.

    Returns
    -------
    xarray.Dataset
    """
    planned = plan(study)
    return family_of(study).build(study, planned.chunks, {})


def result_folder(study: Study, output: str | os.PathLike[str] | None = None) -> Path:
    """Folder of a study's result: `output`, or ``outputs/<name of the study file>-<study id>``.

    Raises
    ------
    StudyError
        Where `output` cannot be the name of a folder that the NetCDF library writes to.
    """
    if output is None:
        name = Path(study.source.path).stem if study.source.path else study.family
        printable = "".join(letter if letter.isprintable() else "_" for letter in name)
        return Path(OUTPUTS) / f"{printable}-{study.study_id}"
    if not os.fspath(output):
        raise StudyError(Problem("the name of the result folder is empty"))
    folder = Path(output)
    try:
        str(folder.absolute()).encode()
    except UnicodeEncodeError:
        raise StudyError(Problem("the name of the result folder is no text", file=str(folder))) from None
    return folder


@dataclass(frozen=True)
class Result:
    """What a run left behind.

    Parameters
    ----------
    folder : pathlib.Path
        With ``result.nc``, ``manifest.json``, ``study.resolved.yaml``, ``report.html`` and ``figures/``.
    seconds : dict of str to float
        Time spent in each stage. [s]
    """

    folder: Path
    seconds: dict[str, float]

    @property
    def path(self) -> Path:
        """The data set."""
        return self.folder / "result.nc"

    def open(self) -> xr.Dataset:
        """Open the data set."""
        return open_result(self.folder)


def open_result(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a result; safe also while other threads run studies.

    Parameters
    ----------
    path : path
        A result folder, or its ``result.nc``.

    Returns
    -------
    xarray.Dataset
        Lazily read; close it, or use it as a context manager.
    """
    import xarray as xr

    from heliosweep.store.lock import LIBRARY_LOCK

    place = Path(path)
    with LIBRARY_LOCK:
        return xr.open_dataset(place / "result.nc" if place.is_dir() else place, engine="netcdf4", lock=LIBRARY_LOCK)


def run(
    study: Study,
    output: str | os.PathLike[str] | None = None,
    *,
    progress: bool = False,
    report: bool = True,
) -> Result:
    """Run a study and leave its result folder.

    Parameters
    ----------
    study : Study
        From `load`.
    output : path, optional
        Result folder; by default ``outputs/<name>-<study id>``.
    progress : bool
        Whether to show progress on standard error.
    report : bool
        Whether to draw figures and write ``report.html``.

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
        Where the run was stopped; no half-written file is left.
    HeliosweepError
        Where the result cannot be written to its end, as on a full disk, or a worker process ended; or where the
        result is complete and its report failed.

    Notes
    -----
    The first run on a machine compiles the kernels and says so by a log message. With ``execution.scheduler:
    processes``, the workers import the script that calls this: it must do so below ``if __name__ == "__main__":``.
    """
    from heliosweep.runtime.execute import execute

    folder = result_folder(study, output)
    planned = plan(study, folder)
    stages = _Stages()
    try:
        with _made(folder):
            with stages("prepare"):
                if report:
                    _check_published(study)
                _prepare_kernels(study)
            with stages("compute"):
                execute(family_of(study), study, planned, folder / "result.nc", progress)
            with stages("record"):
                _record(study, planned, folder, stages)
            if report:
                from heliosweep.report.page import write_report

                with stages("report"):
                    try:
                        write_report(folder, study)
                    except HeliosweepError:
                        raise
                    except Exception as error:  # drawing must not make hours of computing look lost
                        log.debug("the report failed", exc_info=True)
                        raise HeliosweepError(_no_report(folder, error)) from error
    except KeyboardInterrupt:
        raise RunInterrupted(f"interrupted: {_LEFT[stages.current]}; run the same command again") from None
    return Result(folder, stages.seconds)


def _no_report(folder: Path, error: Exception) -> str:
    what = f"{type(error).__name__}: {error}".rstrip(": ")
    again = shlex.join(["heliosweep", "report", str(folder)])
    return f"the result is complete, the report failed ({what}); run: {again}"


#: What an interruption in each stage leaves behind.
_LEFT = {
    "prepare": "nothing was computed yet",
    "compute": "nothing half written was left",
    "record": "result.nc is whole, but its manifest is missing",
    "report": "the result is whole, but its report is not",
}


class _Stages:
    """Times of the stages of a run."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.current = "prepare"

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        start, self.current = time.perf_counter(), name
        yield
        self.seconds[name] = time.perf_counter() - start
        log.debug("%s: %.2f s", name, self.seconds[name])


def _check_published(study: Study) -> None:
    """Find out before anything is computed whether the published numbers fit the study."""
    table = study.report.published
    if table is not None:
        from heliosweep.report.comparison import locate
        from heliosweep.report.published import read_published

        locate(build(study), read_published(study.resolve(table.file), table.source, table.file))


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Make the result folder and try it out; where nothing comes into it, remove what was made."""
    from heliosweep.store.temporary import remove_leftovers, temporary_name

    made: list[Path] = []
    try:
        try:
            for place in (*reversed(folder.parents), folder):
                if not place.is_dir():
                    place.mkdir(exist_ok=True)
                    made.append(place)
            probe = temporary_name(folder / "result.nc")
            probe.touch()
            probe.unlink()
            remove_leftovers(folder)
        except OSError as error:
            problem = f"cannot write there: {error.strerror}; name another folder with --output"
            raise StudyError(Problem(problem, file=str(folder))) from None
        if (folder / "result.nc").is_dir():
            raise StudyError(Problem("is a folder, where the result shall stand", file=str(folder / "result.nc")))
        yield
    except BaseException:
        for place in reversed(made):
            with suppress(OSError):  # something is in it
                place.rmdir()
        raise


def _prepare_kernels(study: Study) -> None:
    """Load the kernels, and tell a user who waits that the first run compiles them.

    Logged as warnings, which Python shows also where nobody set up logging.
    """
    from heliosweep.kernels import compiled

    waiting = threading.Timer(1.5, log.warning, ["compiling the kernels, once on this machine ..."])
    waiting.start()
    try:
        seconds, fresh = family_of(study).prepare(study)
    finally:
        waiting.cancel()
    if fresh and compiled.UNCACHED:
        log.warning(
            "compiled the kernels in %.0f s; no folder for compiled code can be written, so every run compiles them: "
            "name one in the environment variable NUMBA_CACHE_DIR",
            seconds,
        )
    elif fresh:
        log.warning("compiled the kernels in %.0f s; later runs find them in the cache", seconds)


def _record(study: Study, planned: Plan, folder: Path, stages: _Stages) -> None:
    """Write the manifest and the resolved study."""
    from heliosweep.config.identity import resolved_yaml
    from heliosweep.store.digest import content_digest, file_digest
    from heliosweep.store.manifest import environment, write_atomically, write_manifest

    result = folder / "result.nc"
    write_atomically(folder / "study.resolved.yaml", resolved_yaml(study, relative_to=folder))
    with open_result(folder) as data:
        remarks = list(family_of(study).remarks(data))
    for remark in remarks:
        log.warning("warning: %s", remark)
    write_manifest(
        folder / "manifest.json",
        {
            "study_id": study.study_id,
            "study_file": str(study.source.path),
            "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "result": {
                "file": result.name,
                "bytes": result.stat().st_size,
                "sha256": file_digest(result),
                "content_digest": content_digest(result),
            },
            "plan": {
                "dimensions": planned.workload.sizes,
                "points": planned.workload.points,
                "evaluations": planned.workload.points * planned.workload.evaluations,
                "blocks": planned.blocks,
                "chunks": planned.chunks,
                "seconds": planned.seconds,
                "peak_memory": planned.peak_memory,
            },
            "remarks": remarks,
            "scheduler": study.execution.scheduler,
            "workers": planned.workers,
            "seconds": stages.seconds,
            "environment": environment(),
        },
    )
