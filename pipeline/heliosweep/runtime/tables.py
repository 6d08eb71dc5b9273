"""A plan in words."""

from __future__ import annotations

from pathlib import Path

from heliosweep.config.study import Study
from heliosweep.grid.limits import human_bytes, human_seconds
from heliosweep.grid.plan import Plan
from heliosweep.runtime.status import status_of


def plan_text(study: Study, plan: Plan, folder: Path) -> str:
    """Say what a study will cost, one quantity a line.

    Parameters
    ----------
    study : Study
        The study.
    plan : Plan
        Its plan.
    folder : pathlib.Path
        Where its result will go.

    Returns
    -------
    str
    """
    workload = plan.workload
    chunks = {dim: length for dim, length in plan.chunks.items() if length < workload.sizes.get(dim, 0)}
    rows = {
        "study": f"{study.title or study.family} ({study.family}, {study.study_id})",
        "dimensions": _lengths(workload.sizes) or "none",
        "points": f"{workload.points:,} parameter combinations",
        "evaluations": f"{workload.points * workload.evaluations:,} {workload.unit}",
        "blocks": f"{plan.blocks:,}" + (f", each at most {_lengths(chunks)}" if chunks else ""),
        "parts": f"{plan.part_count:,}, each of which is kept once it is done{_done(folder)}",
        "workers": f"{plan.workers} ({study.execution.scheduler})",
        "peak memory": f"about {human_bytes(plan.peak_memory)}",
        "output": f"{human_bytes(plan.output_bytes)} in {folder}",
        "time": f"about {human_seconds(plan.seconds)} in the kernels",
    }
    width = max(map(len, rows))
    return "\n".join(f"{name:{width}}  {value}" for name, value in rows.items())


def _done(folder: Path) -> str:
    """What earlier runs have left in the folder, in words."""
    status = status_of(folder)
    return {"complete": "; all are done", "not run": ""}.get(status.state, f"; {status.detail}")


def _lengths(sizes: dict[str, int]) -> str:
    return ", ".join(f"{dim} {length:,}" for dim, length in sizes.items())
