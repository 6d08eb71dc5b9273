"""Progress: lines without a terminal, a bar on one."""

from __future__ import annotations

import io

from heliosweep.runs import progress


def test_lines_without_a_terminal(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(progress, "LINE_SECONDS", -1.0)
    with progress.show_progress("study", 4, stream) as shown:
        for _ in range(4):
            shown.advance()
    lines = stream.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("study: 25 %, about ")


def test_bar_on_a_terminal():
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    stream = Terminal()
    with progress.show_progress("mirrors [/bold] of [m]", 4, stream) as shown:
        shown.advance(2)
    assert "mirrors [/bold] of [m]" in stream.getvalue()
