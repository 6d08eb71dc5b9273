"""Blocks of a result, which are written, and chunks, which are computed and stored one at a time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from heliosweep.grid.regions import Region


class Piece(NamedTuple):
    """Block or chunk of a result."""

    name: str
    """Kind and number, such as ``points-00012``."""
    kind: str
    """``points`` without ``time``, ``series`` with ``time``."""
    region: dict[str, slice]
    """Slices of the dimensions that are cut."""


@dataclass(frozen=True)
class Cut:
    """Lengths of the blocks and chunks of the variables of one kind.

    Blocks follow from the study only, and with them the bytes of a result. Each chunk is in one block.

    Parameters
    ----------
    sizes, block, chunk : mapping of str to int
        Lengths of the dimensions that are cut, and of a block and of a chunk along each of them.
    """

    sizes: Mapping[str, int]
    block: Mapping[str, int]
    chunk: Mapping[str, int]

    def blocks(self) -> Iterator[dict[str, slice]]:
        """Return the regions of the blocks in the order of the file, last dimension fastest."""
        return regions({dim: slice(0, size) for dim, size in self.sizes.items()}, self.block)

    @property
    def chunk_count(self) -> int:
        """Number of chunks."""
        return math.prod(
            size // block * -(-block // chunk) + -(-(size % block) // chunk)
            for size, block, chunk in ((size, self.block[dim], self.chunk[dim]) for dim, size in self.sizes.items())
        )


def blocks_of(cuts: Mapping[str, Cut]) -> Iterator[Piece]:
    """Yield the blocks of a result in the order of the file."""
    for kind, cut in cuts.items():
        yield from _named(kind, cut.blocks())


def chunks_by_block(cuts: Mapping[str, Cut]) -> Iterator[tuple[Piece, list[Piece]]]:
    """Yield each block of a result with its chunks."""
    numbers = dict.fromkeys(cuts, 0)
    for block in blocks_of(cuts):
        chunks = list(_named(block.kind, regions(block.region, cuts[block.kind].chunk), numbers[block.kind]))
        numbers[block.kind] += len(chunks)
        yield block, chunks


def piece_name(kind: str, number: int) -> str:
    """Return the name of a block or chunk."""
    return f"{kind}-{number:05}"


def _named(kind: str, pieces: Iterable[dict[str, slice]], first: int = 0) -> Iterator[Piece]:
    return (Piece(piece_name(kind, number), kind, region) for number, region in enumerate(pieces, first))


def regions(region: Region, lengths: Mapping[str, int]) -> Iterator[dict[str, slice]]:
    """Cut a region into pieces of at most these lengths, last dimension fastest."""
    spans = (
        [slice(first, min(first + lengths[dim], span.stop)) for first in range(span.start, span.stop, lengths[dim])]
        for dim, span in region.items()
    )
    return (dict(zip(region, each, strict=True)) for each in itertools.product(*spans))


def shortened(
    lengths: Mapping[str, int], order: Iterable[tuple[str, int]], fits: Callable[[Mapping[str, int]], bool]
) -> dict[str, int]:
    """Halve lengths until they fit: each dimension of `order` down to a minimum, one after the other."""
    found = dict(lengths)
    for dim, minimum in order:
        while found[dim] > minimum and not fits(found):
            found[dim] = max(minimum, -(-found[dim] // 2))
    return found
