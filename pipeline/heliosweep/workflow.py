"""From a study file to a result folder: load, plan, build, run, open.

These five functions are the library's public face; the command line calls nothing else.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heliosweep.config.load import load as load_file
from heliosweep.config.load import load_mapping
from heliosweep.config.study import Study
from heliosweep.errors import Problem, RunInterrupted, StudyError
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
    return make_plan(family_of(study).workload(study), limits, execution.chunks)


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
    """Folder of a study's result: `output`, or ``outputs/<name of the study file>-<study id>``."""
    if output is not None:
        return Path(output)
    name = Path(study.source.path).stem if study.source.path else study.family
    return Path(OUTPUTS) / f"{name}-{study.study_id}"


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
    """Open a result.

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

    place = Path(path)
    return xr.open_dataset(place / "result.nc" if place.is_dir() else place, engine="netcdf4")


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
    """
    from heliosweep.runtime.execute import execute

    folder = result_folder(study, output)
    planned = plan(study, folder)
    stages = _Stages()
    try:
        with stages("prepare"):
            if report:
                _check_published(study)
            _make_writable(folder)
            _prepare_kernels(family_of(study))
        with stages("compute"):
            execute(family_of(study), study, planned, folder / "result.nc", progress)
        with stages("record"):
            _record(study, planned, folder, stages)
        if report:
            from heliosweep.report.page import write_report

            with stages("report"):
                write_report(folder, study)
    except KeyboardInterrupt:
        raise RunInterrupted("interrupted: nothing half written was left; run the same command again") from None
    return Result(folder, stages.seconds)


class _Stages:
    """Times of the stages of a run."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
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


def _make_writable(folder: Path) -> None:
    """Make the result folder and try it out before anything is computed."""
    probe = folder / f".probe.{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise StudyError(
            Problem(f"cannot write there: {error.strerror}; name another folder with --output", file=str(folder))
        ) from None


def _prepare_kernels(family: Family[Any]) -> None:
    """Load the kernels, and tell a user who waits that the first run compiles them."""
    waiting = threading.Timer(1.5, log.info, ["compiling the kernels, once on this machine ..."])
    waiting.start()
    try:
        seconds, compiled = family.prepare()
    finally:
        waiting.cancel()
    if compiled:
        log.info("compiled the kernels in %.0f s; later runs find them in the cache", seconds)


def _record(study: Study, planned: Plan, folder: Path, stages: _Stages) -> None:
    """Write the manifest and the resolved study."""
    from heliosweep.config.identity import resolved_yaml
    from heliosweep.store.digest import content_digest, file_digest
    from heliosweep.store.manifest import environment, write_atomically, write_manifest

    result = folder / "result.nc"
    write_atomically(folder / "study.resolved.yaml", resolved_yaml(study))
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
            "scheduler": study.execution.scheduler,
            "workers": planned.workers,
            "seconds": stages.seconds,
            "environment": environment(),
        },
    )
