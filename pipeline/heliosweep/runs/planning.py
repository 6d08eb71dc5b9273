"""Plan of a study on this machine, or on the workers of a cluster."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heliosweep.errors import StudyError
from heliosweep.families.lookup import family_of
from heliosweep.families.searched import Searched
from heliosweep.grid.lazy import Work
from heliosweep.grid.machine import machine_limits
from heliosweep.grid.plan import Plan, make_plan
from heliosweep.grid.trial import trial_seconds
from heliosweep.store.chunks import CHUNKS

if TYPE_CHECKING:
    from heliosweep.config.study import Study

#: Kinds of workers on this machine.
_HERE = ("synchronous", "threads", "processes", "distributed")


def plan_study(study: Study, folder: Path, *, connect: bool = False) -> Plan:
    """Plan a study.

    Parameters
    ----------
    study : Study
        The study.
    folder : pathlib.Path
        Result folder; its file system gives the free disk.
    connect : bool
        Ask a scheduler at an address for the number of its workers.

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        If the study does not fit.
    StudyError
        If a scheduler does not answer, or chunks are unknown.
    """
    execution, family = study.execution, family_of(study)
    if isinstance(family, Searched):  # a generation has to fit
        return family.plan(study, plan_study(family.first(study), folder, connect=connect))
    remote = "://" in execution.scheduler or execution.cluster
    try:
        workers = execution.workers
        if connect and "://" in execution.scheduler:
            from heliosweep.runs.executors import worker_count

            workers = worker_count(execution)
        limits = machine_limits(workers, execution.memory, folder)
        stored = sum(file.stat().st_size for file in folder.glob(f"{CHUNKS}*/*"))
        limits = replace(limits, disk=limits.disk + stored)  # existing chunks need no more
        where: Any = "elsewhere" if remote else "processes" if execution.scheduler in _HERE[2:] else "here"
        # The chunks stay on the disk until the result is written: two copies.
        workload, variables = family.workload(study), family.variables(study)
        return make_plan(workload, variables, limits, execution.chunks, where=where, copies=2)
    except StudyError as error:  # with keys, but without their places in the study file
        raise StudyError(
            problem if problem.file or study.source.data.get("execution") is None
            else study.problem(problem.key, problem.message)
            for problem in error.problems
        ) from None  # fmt: skip


def timed_plan(study: Study, folder: Path) -> Plan:
    """Plan a study, and extrapolate its time from a small region that is computed, if that takes a few seconds."""
    plan, family = plan_study(study, folder), family_of(study)
    tried = plan
    if isinstance(family, Searched):
        first = family.first(study)
        tried, family, study = plan_study(first, folder), family.family, first
    seconds = trial_seconds(Work(family, study, tried.variables, tried.workload.sizes), tried)
    return plan if seconds is None else replace(plan, seconds=seconds * plan.workload.points / tried.workload.points)
