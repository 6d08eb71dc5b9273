"""The files that a study names, watched while it runs."""

from __future__ import annotations

from pathlib import Path

from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError


class Inputs:
    """What a study's files held when its run began.

    Parameters
    ----------
    study : Study
        The study.
    """

    def __init__(self, study: Study) -> None:
        self._study = study
        names = {name for named in study.files().values() for name in named}
        self._paths = sorted(study.resolve(name) for name in names)
        self._stamps = self._look()
        self.study_id = study.study_id

    def check(self) -> None:
        """Make sure that they still say the same.

        Raises
        ------
        HeliosweepError
            Where one was edited: what was computed since belongs to no study.
        """
        stamps = self._look()
        if stamps == self._stamps:
            return
        edited = [path for path, before, now in zip(self._paths, self._stamps, stamps, strict=True) if before != now]
        if self._study.study_id != self.study_id:
            raise HeliosweepError(
                f"{edited[0]}: was edited while the study ran; the parts done before are kept. Put it back and run "
                "the same command again to go on with this study, or run the edited one, which is another study"
            )
        self._stamps = stamps

    def _look(self) -> list[tuple[int, int, int] | None]:
        return [_stamp(path) for path in self._paths]


def _stamp(path: Path) -> tuple[int, int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
