"""The graph of a part as few tasks: one for each block, and one for all that follows from the blocks.

A block takes milliseconds to a quarter of a second and any other task of a part some microseconds, while the scheduler
of dask.distributed takes about a millisecond for each, on the cores that the workers would use.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import dask
import numpy as np
from dask.array.core import finalize
from dask.core import flatten
from dask.optimization import cull

from heliosweep.grid.evaluate import CONSTANT_MARK, PREPARE_MARK, TASK_MARK
from heliosweep.grid.pieces import Constant

if TYPE_CHECKING:
    import xarray as xr

Graph: TypeAlias = dict[Any, Any]


def fused(lazy: xr.Dataset, name: str, group: str) -> Graph:
    """Fuse the graph of a part.

    What a block is made from, as the sun, is made in its task, perhaps in those of other blocks too; only constants,
    which are large, stay tasks that blocks share.

    Parameters
    ----------
    lazy : xarray.Dataset
        Variables of a part, all of them lazy.
    name : str
        Key of the task that gives their values, a dict of str to numpy.ndarray.
    group : str
        Of the blocks of all parts of a run. The scheduler hands out one by one the tasks of a large group alone; of
        those of a small one, as the blocks of the last part are, it would give one worker several while others wait.

    Returns
    -------
    dict
        The graph.
    """
    keys = {str(label): array.data.__dask_keys__() for label, array in lazy.data_vars.items()}
    wanted = list(flatten(list(keys.values())))
    graph, needs = cull(dict(lazy.__dask_graph__() or {}), wanted)
    work = {key for key in graph if TASK_MARK in _name(key)}
    constants = {key for key in graph if _name(key).startswith(CONSTANT_MARK)}
    before, _ = _behind((need for key in work for need in needs[key]), needs, ())
    # What waits for no block and is behind none: every worker shall have a share of it too.
    free = {key for key in graph.keys() - before if constants.issuperset(needs[key])}
    blocks = work | {key for key in free if _name(key).startswith(PREPARE_MARK)}
    called = {key: (f"{TASK_MARK}{group}", name, key) for key in work}
    few: Graph = {}
    for key in blocks:
        inside, waits = _behind(needs[key], needs, blocks | constants)
        given = [called.get(other, other) for other in waits]
        few[called.get(key, key)] = (_Fused({other: graph[other] for other in (*inside, key)}, key, waits), given)
    inside, waits = _behind(wanted, needs, blocks | constants)
    given = [called.get(other, other) for other in waits]
    few[name] = (_Fused({other: graph[other] for other in inside}, keys, waits), given)
    return few | {key: graph[key] for key in constants}


def _name(key: Any) -> str:
    return str(key[0] if isinstance(key, tuple) else key)


def _behind(
    keys: Iterable[Any], needs: Mapping[Any, Collection[Any]], ends: Collection[Any]
) -> tuple[set[Any], list[Any]]:
    """Keys and all that they need, without those of `ends`; and those of `ends` that are met."""
    inside: set[Any] = set()
    met: dict[Any, None] = {}
    stack = list(keys)
    while stack:
        key = stack.pop()
        if key in ends:
            met[key] = None
        elif key not in inside:
            inside.add(key)
            stack += needs[key]
    return inside, list(met)


@dataclass(frozen=True, slots=True)
class _Fused:
    """Several tasks as one.

    Parameters
    ----------
    graph : dict
        The tasks.
    wanted : object
        Key of the task whose value is given back; or keys of all blocks of arrays by the names of these.
    waits : sequence
        Keys of the values that it is called with.
    """

    graph: Graph
    wanted: Any
    waits: Sequence[Any]

    def __dask_tokenize__(self) -> Any:
        """What tells it from all others: names, that of what it makes is unique; else dask would pickle the tasks."""
        return type(self).__name__, self.wanted

    def __call__(self, given: Sequence[Any]) -> Any:
        graph = self.graph | {key: (Constant(value),) for key, value in zip(self.waits, given, strict=True)}
        if not isinstance(self.wanted, dict):
            return dask.get(graph, self.wanted)
        blocks = dask.get(graph, list(self.wanted.values()))  # at once: variables share tasks
        return {name: np.asarray(finalize(values)) for name, values in zip(self.wanted, blocks, strict=True)}
