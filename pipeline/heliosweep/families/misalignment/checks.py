"""What must hold between the blocks of a study, its layouts and the sun; NumPy only, for quick validation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from heliosweep.errors import Problem

if TYPE_CHECKING:
    from heliosweep.families.misalignment.config import MisalignmentStudy


def check(study: MisalignmentStudy) -> tuple[list[Problem], list[str]]:
    """Check a study whose blocks are right by themselves; problems, and notes for the user."""
    return [], []
