"""A plan in words."""

from __future__ import annotations

from pathlib import Path

from heliosweep.config.study import Study
from heliosweep.grid.limits import human_lengths
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
    words, sizes = plan.in_words(), plan.workload.sizes
    chunks = {dim: length for dim, length in plan.chunks.items() if length < sizes.get(dim, 0)}
    rows = {
        "study": f"{study.title or study.family} ({study.family}, {study.study_id})",
        "dimensions": words["dimensions"],
        "points": words["points"],
        "evaluations": words["evaluations"],
        "blocks": f"{plan.blocks:,}" + (f", each at most {human_lengths(chunks)}" if chunks else ""),
        "parts": f"{plan.part_count:,}, each of which is kept once it is done{_done(folder)}",
        "workers": f"{plan.workers} ({study.execution.scheduler})",
        "peak memory": words["peak memory"],
        "output": f"{words['output']} in {folder}",
        "time": words["time"],
    }
    width = max(map(len, rows))
    return "\n".join(f"{name:{width}}  {value}" for name, value in rows.items())


def _done(folder: Path) -> str:
    """What earlier runs have left in the folder, in words."""
    status = status_of(folder)
    return {"complete": "; all are done", "not run": ""}.get(status.state, f"; {status.detail}")
