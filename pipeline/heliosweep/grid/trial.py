"""Time of a study, extrapolated from one small region that is computed in a separate process."""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
import time
from typing import TYPE_CHECKING

from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Plan
from heliosweep.grid.regions import Cut, Part

if TYPE_CHECKING:
    from heliosweep.grid.lazy import Work

#: Maximum time of the process, with its imports; and time of a region from which the whole is extrapolated. [s]
TIMEOUT, ENOUGH = 6.0, 0.5
#: Initial length of the region along a dimension that one parameter point may be cut along.
FIRST_LENGTH = 32


def trial_seconds(work: Work, plan: Plan) -> float | None:
    """Return the time that the parts of a plan take on its workers, without reading and writing.

    Parameters
    ----------
    work : Work
        Study with its inputs.
    plan : Plan
        Its plan.

    Returns
    -------
    float or None
        Extrapolated time [s]; None if the trial fails or does not end in time, for instance because the kernels are not
        compiled yet.
    """
    try:
        sent = pickle.dumps((work, plan.cuts))
        command = [sys.executable, "-m", __name__]
        answer = subprocess.run(command, input=sent, capture_output=True, timeout=TIMEOUT, check=True)
        return float(answer.stdout) / plan.workers
    except (OSError, ValueError, TypeError, AttributeError, pickle.PicklingError, subprocess.SubprocessError):
        return None


def measure(work: Work, kind: str, cut: Cut) -> float:
    """Compute regions in the middle of a result, larger and larger, and extrapolate to all of its values. [s]"""
    lengths = {dim: length if dim == "time" else 1 for dim, length in cut.part.items()}
    for dim in cut.part.keys() - {*Parameters(work.study).sizes, "time"}:
        lengths[dim] = min(FIRST_LENGTH, cut.part[dim])
    while True:
        middle = {dim: (cut.sizes[dim] - length) // 2 for dim, length in lengths.items()}
        region = {dim: slice(first, first + lengths[dim]) for dim, first in middle.items()}
        began = time.perf_counter()
        work.compute(Part("trial", kind, region))
        seconds = time.perf_counter() - began
        shorter = [dim for dim, length in lengths.items() if length < cut.part[dim]]
        if seconds >= ENOUGH or not shorter:
            return seconds * math.prod(cut.sizes.values()) / math.prod(lengths.values())
        factor = max(2, min(16, int(ENOUGH / max(seconds, 1e-6))))
        lengths[shorter[-1]] = min(cut.part[shorter[-1]], factor * lengths[shorter[-1]])


if __name__ == "__main__":
    work, cuts = pickle.load(sys.stdin.buffer)
    work.family.prepare(work.study)
    print(sum(measure(work, kind, cut) for kind, cut in cuts.items()))
