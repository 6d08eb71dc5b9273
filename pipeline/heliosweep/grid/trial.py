"""Time of a study, extrapolated from one small region that is computed in a separate process."""

from __future__ import annotations

import itertools
import math
import pickle
import subprocess
import sys
import time
from typing import TYPE_CHECKING

from heliosweep.grid.blocks import Cut, Piece
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Plan

if TYPE_CHECKING:
    from heliosweep.grid.lazy import Work

#: Maximum time of the process, with its imports; and time of a region from which the whole is extrapolated. [s]
TIMEOUT, ENOUGH = 10.0, 0.5
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
    """Compute regions of increasing size and extrapolate to all values of a kind; the first one only warms up. [s]"""
    swept = Parameters(work.study).sizes
    lengths = {
        dim: length if dim == "time" else min(length, 1 if dim in swept else FIRST_LENGTH)
        for dim, length in cut.chunk.items()
    }
    for trial in itertools.count():
        region = {}
        for dim, length in lengths.items():  # each trial at another place, for neighbours may share results
            start = (cut.sizes[dim] // 3 + trial * length) % (cut.sizes[dim] - length + 1)
            region[dim] = slice(start, start + length)
        began = time.perf_counter()
        work.compute(Piece("trial", kind, region))
        seconds = time.perf_counter() - began
        shorter = [dim for dim, length in lengths.items() if length < cut.chunk[dim]]
        if trial and (seconds >= ENOUGH or not shorter):
            break
        if trial:
            factor = max(2, min(16, int(ENOUGH / max(seconds, 1e-6))))
            lengths[shorter[-1]] = min(cut.chunk[shorter[-1]], factor * lengths[shorter[-1]])
    return seconds * math.prod(cut.sizes.values()) / math.prod(lengths.values())


if __name__ == "__main__":
    work, cuts = pickle.load(sys.stdin.buffer)
    work.family.prepare(work.study)
    print(sum(measure(work, kind, cut) for kind, cut in cuts.items()))
