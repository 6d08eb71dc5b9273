"""Command-line interface. Results go to standard output; progress and messages go to standard error."""

from __future__ import annotations

import argparse
import io
import logging
import os
import re
import signal
import sys
import threading
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NamedTuple, TypeAlias

from heliosweep import __version__
from heliosweep.errors import HeliosweepError, RunInterrupted, printable

EXIT_CODES = """\
exit codes: 0 success, 1 failure (verify: not intact; compare: not equal), 2 invalid study or usage,
3 study too large for this machine, 4 interrupted (can be resumed)"""

#: Figure formats. HTML reports always contain figures in the first format.
FIGURES = ("png", "svg", "pdf")


class Command(NamedTuple):
    """Help text, `argparse` arguments and examples of a command. Examples omit the name of the command."""

    help: str
    arguments: tuple[_Argument, ...] = ()
    examples: tuple[str, ...] = ("",)


#: Names and settings that are passed to ``argparse.ArgumentParser.add_argument``.
_Argument: TypeAlias = tuple[tuple[str, ...], dict[str, Any]]


def _argument(*names: str, **settings: Any) -> _Argument:
    return names, settings


#: Removed options and their replacements.
_REMOVED = {
    "--profile": "use --set execution.KEY=VALUE, or include a file with these keys",
    "--compression": "set output.compression in the study",
    "--ro-crate": "archives are described by README.md, CITATION.cff and SHA256SUMS",
}


class _Removed(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        parser.error(f"{self.option_strings[0]} was removed; {_REMOVED[self.option_strings[0]]}")


def _angles(text: str) -> Any:
    try:
        if ":" in text:
            return dict(zip(("start", "stop", "step"), map(float, text.split(":")), strict=True))
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be numbers such as 0,30,60 or START:STOP:STEP (got {text})") from None


def _choice(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise argparse.ArgumentTypeError(f"must be KEY=VALUE (got {text})")
    return name.strip(), value.strip()


def _formats(text: str) -> tuple[str, ...]:
    given = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",")))
    if set(given) - set(FIGURES):
        raise argparse.ArgumentTypeError(f"must be a comma-separated list of {', '.join(FIGURES)} (got {text})")
    return given


def _removed(option: str) -> _Argument:
    return _argument(option, action=_Removed, nargs="?", help=argparse.SUPPRESS)


def _force(text: str = "replace an existing file") -> _Argument:
    return _argument("--force", action="store_true", help=text)


_STUDIES = _argument("studies", nargs="+", metavar="STUDY.yaml")
_FAMILY = _argument("family", metavar="FAMILY")
_RESULT = "result folder, or a study that has been run"
_SET = _argument(
    "--set", metavar="KEY=VALUE", action="append", default=[],
    help="override a study key (repeatable); null removes the key",
)  # fmt: skip
_EXECUTION = (
    _SET,
    _argument("-o", "--output", metavar="DIR", help="result folder (default: outputs/<study>-<id>)"),
    _argument("--scheduler", metavar="NAME",
             help="threads, processes, synchronous, distributed or tcp://HOST:PORT (default: threads)"),
    _argument("--workers", metavar="N", help="number of parts to compute in parallel (default: all cores)"),
    _argument("--memory", metavar="SIZE", help='memory limit, such as "2 GB" (default: free memory)'),
    _removed("--profile"),
)  # fmt: skip
_SELECT: dict[str, Any] = {"metavar": "KEY=VALUE", "type": _choice, "action": "append", "default": []}
_ANGLES = "in deg, such as 0,30,60 or START:STOP:STEP"

COMMANDS: dict[str, Command] = {
    "validate": Command(
        "check study files and list all problems with their line numbers",
        (_STUDIES, _SET),
        ("my_field.yaml", "studies/*.yaml", "my_field.yaml --set receiver.height=90"),
    ),
    "plan": Command(
        "estimate the grid size, memory, disk space and run time of a study",
        (_argument("study", metavar="STUDY.yaml"), *_EXECUTION),
        ("my_field.yaml", 'my_field.yaml --set "site.latitude=[0, 20, 40]"'),
    ),
    "run": Command(
        "run or resume studies, and print the path of the result (or one line per study)",
        (
            _STUDIES,
            *_EXECUTION,
            _force("recompute everything"),
            _argument("--no-report", action="store_true", help="omit figures and HTML page"),
            _argument("-q", "--quiet", action="store_true", help="omit progress and headline numbers"),
        ),
        (
            "my_field.yaml",
            "my_field.yaml --set receiver.height=90 --set tracking=azimuth_elevation",
            "my_field.yaml --output results/first --scheduler processes --workers 4",
        ),
    ),
    "status": Command(
        "show the state and remaining time of studies",
        (_argument("of", nargs="*", metavar="STUDY.yaml|DIR", help="studies or result folders (default: outputs/)"),),
        ("", "my_field.yaml"),
    ),
    "verify": Command(
        "check result folders against their SHA-256 checksums",
        (
            _argument(
                "folders", nargs="+", metavar="DIR|STUDY.yaml", help="result folders, or studies that have been run"
            ),
        ),
        ("my_field.yaml", "outputs/*/"),
    ),
    "compare": Command(
        "compare two results by content, or write a page that compares several results",
        (
            _argument("first", metavar="A", help="result folder, NetCDF file, or a study that has been run"),
            _argument("others", metavar="B", nargs="+", help="result to compare with A; more than one requires --page"),
            _argument(
                "--page",
                metavar="FILE.html",
                help="write a page with inputs, results and differences from A, and print its path",
            ),
            _force("replace an existing page"),
            _argument("--rtol", type=float, default=0.0, help="relative tolerance (default: 0)"),
            _argument("--atol", type=float, default=0.0, help="absolute tolerance (default: 0)"),
        ),
        (
            "outputs/first outputs/second",
            "first.nc second.nc --rtol 1e-9",
            "low.yaml middle.yaml high.yaml --page heights.html",
        ),
    ),
    "export": Command(
        "export a result to Excel or CSV, and print the path of the file",
        (
            _argument("source", metavar="DIR|STUDY.yaml", help=_RESULT),
            _argument("-o", "--output", metavar="FILE", help="write an .xlsx or .csv file"),
            _argument("--csv", dest="output", metavar="FILE.csv", help=argparse.SUPPRESS),
            _argument(
                "--variable",
                metavar="NAME",
                action="append",
                help="export this variable (repeatable; default: all)",
            ),
            _removed("--compression"),
            _force(),
        ),
        ("my_field.yaml -o numbers.xlsx", "outputs/first -o table.csv --variable field_optical_efficiency"),
    ),
    "convert": Command(
        "convert a layout to SolarPILOT or CSV format, a PAINT folder to a study, or a calibration to corrections",
        (
            _argument("source", metavar="STUDY.yaml|FIELD.csv|DIR"),
            _argument(
                "target",
                metavar="FILE.csv",
                help=("output file; STUDY.yaml writes a study and its tables from a PAINT folder"),
            ),
            _argument(
                "--to",
                choices=("solarpilot", "csv", "spots", "corrections"),
                help="format (default: solarpilot; csv for a PAINT folder); spots: measured spots from a PAINT folder; "
                "corrections: estimated mount errors from a calibration, for the heliostat controller",
            ),
            _argument("--select", **_SELECT, help="select one point of a result with several points (repeatable)"),
            _argument("--aim", metavar="NAME", default="receiver", help="target in a PAINT folder (default: receiver)"),
            _force(),
        ),
        ("my_field.yaml positions.csv", "positions.csv field.csv --to csv"),
    ),
    "table": Command(
        "write the efficiency of a field over sun directions for SAM or SolarPILOT",
        (
            _argument("source", metavar="STUDY.yaml|DIR"),
            _argument("-o", "--output", metavar="FILE.csv", help="write this file", required=True),
            _argument(
                "--form",
                choices=("tower", "generic", "solarpilot"),
                default="tower",
                help="SAM power tower, SAM generic solar field, or SolarPILOT (default: tower)",
            ),
            _argument(
                "--azimuth", type=_angles, help=f"sun azimuth from north, clockwise, {_ANGLES} (default: 0:360:15)"
            ),
            _argument("--elevation", type=_angles, help=f"sun elevation {_ANGLES} (default: 0:90:5)"),
            _argument("--select", **_SELECT, help="select a point of the sweep (repeatable)"),
            _argument(
                "--factor",
                type=float,
                default=1.0,
                help="product of efficiency factors that are not computed, such as absorptance, 0 to 1 (default: 1)",
            ),
            _argument("--flux-maps", metavar="FILE.csv", help="also write the flux maps of the SAM power tower"),
            _force(),
        ),
        ("my_field.yaml -o efficiency.csv --azimuth 0:345:15 --elevation 5:85:10",),
    ),
    "electricity": Command(
        "compute the electricity from a plant with SAM and the weather in its study (requires the extra 'sam')",
        (
            _argument("source", metavar="DIR|STUDY.yaml", help=_RESULT),
            _argument(
                "-o",
                "--output",
                metavar="FILE.nc",
                help="write the hourly values to this file (default: electricity.nc in the result folder)",
            ),
            _argument("--select", **_SELECT, help="select a point of the sweep (repeatable)"),
            _argument(
                "--sam",
                metavar="NAME=VALUE",
                action="append",
                default=[],
                help="set an input of SAM's molten-salt tower, such as tshours=6 (repeatable)",
            ),
            _force(),
        ),
        ("my_field.yaml", "outputs/first --select receiver.height=90 --sam solarm=2 --sam tshours=6"),
    ),
    "weather": Command(
        "download weather data for a location, and print the path of the file",
        (
            _argument("service", choices=("pvgis", "nsrdb"), help="data service; nsrdb requires a key"),
            _argument("--latitude", type=float, required=True, metavar="DEG", help="latitude, positive north"),
            _argument("--longitude", type=float, required=True, metavar="DEG", help="longitude, positive east"),
            _argument("-o", "--output", metavar="FILE.csv", help="write this file", required=True),
            _argument("--year", type=int, metavar="N", help="calendar year (default: a typical year)"),
            _argument("--url", metavar="URL", help="URL of the data service (default: the public service)"),
            _force(),
        ),
        (
            "pvgis --latitude 37.09 --longitude -2.36 -o site.csv",
            "pvgis --latitude 37.09 --longitude -2.36 --year 2019 -o y2019.csv",
        ),
    ),
    "report": Command(
        "redraw the figures and the HTML page of a result folder",
        (
            _argument("folder", metavar="DIR|STUDY.yaml", help=_RESULT),
            _argument("--summary", action="store_true", help="write summary.html, which fits on one printed page"),
            _argument(
                "--format",
                type=_formats,
                default=(),
                metavar="LIST",
                help=f"figure formats, from {', '.join(FIGURES)} (default: png)",
            ),
        ),
        ("my_field.yaml", "outputs/first --format png,svg,pdf", "outputs/first --summary"),
    ),
    "pack": Command(
        "pack a finished result into an archive for publication, and print the path of the archive",
        (
            _argument("folder", metavar="DIR|STUDY.yaml", help=_RESULT),
            _argument("-o", "--output", metavar="FILE.zip", help="write this archive (default: DIR.zip)"),
            _argument("--license", metavar="SPDX", help="license of the data (default: dataset.license in the study)"),
            _argument("--draft", action="store_true", help="allow missing creators and license"),
            _removed("--ro-crate"),
            _force("replace an existing archive"),
        ),
        ("my_field.yaml", "outputs/first -o first.zip --license CC0-1.0"),
    ),
    "new": Command(
        "write a commented example study, and print its path",
        (
            _FAMILY,
            _argument("file", nargs="?", metavar="FILE.yaml", help="write this file (default: FAMILY.yaml)"),
            _force(),
        ),
        ("field_efficiency", "dish_tracking my_dish.yaml"),
    ),
    "explain": Command(
        "explain a study key (unit, range, default, forms) or a result variable",
        (
            _argument(
                "of",
                nargs="+",
                metavar="[FAMILY] KEY",
                help="key, such as receiver.height; a family alone lists its keys",
            ),
        ),
        ("receiver.height", "field_receiver_energy", "field_efficiency optics", "field_efficiency"),
    ),
    "examples": Command(
        "list the bundled studies, or copy some of them",
        (
            _argument("names", nargs="*", metavar="NAME", help="studies to copy with their input files"),
            _argument("--to", metavar="DIR", default=".", help="copy to this folder (default: current folder)"),
            _force("replace existing files"),
        ),
        ("", "chong2012_table2 --to studies"),
    ),
    "setup": Command("compile all kernels now instead of during the first run"),
    "schema": Command("print the JSON Schema of a family, for use in editors", (_FAMILY,), ("field_efficiency",)),
    "families": Command("list the study families"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command with the given arguments (default: `sys.argv`), and return its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # a termination signal ends the run like Ctrl-C
    given = sys.argv[1:] if arguments is None else arguments
    if not given:
        parser().print_help(sys.stderr)
        return 2
    options = parser().parse_args(given)
    try:
        commands = import_module("heliosweep.commands")  # imported late, because its dependencies are slow to import
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(commands.Formatter("%(message)s"))
        logging.basicConfig(level=logging.WARNING, handlers=[handler])
        logging.getLogger("heliosweep").setLevel(logging.DEBUG if options.verbose else logging.INFO)
        return commands.carry_out(options)
    except (RunInterrupted, KeyboardInterrupt) as stop:
        print(printable(stop) or "interrupted", file=sys.stderr)
        return RunInterrupted.exit_code
    except BrokenPipeError:  # a program that reads the output, such as head, has ended
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (HeliosweepError, OSError) as error:
        if options.verbose and isinstance(error, OSError):
            raise
        return commands.refused(error)


def parser() -> argparse.ArgumentParser:
    """Return the command-line parser. The parser stores the name of the command as `command`."""
    main = _Parser(
        prog="heliosweep",
        description="Batch studies of solar-concentrator tracking and optics: from a YAML file to a NetCDF data set.",
        epilog=EXIT_CODES,
    )
    main.add_argument("--version", action="version", version=f"heliosweep {__version__}")
    commands = main.add_subparsers(title="commands", metavar="COMMAND", dest="command", required=True)
    verbose = _argument("-v", "--verbose", action="store_true", help="print details and durations")
    for name, command in COMMANDS.items():
        lines = [f"  heliosweep {name} {line}".rstrip() for line in command.examples]
        parser = commands.add_parser(
            name,
            help=command.help,
            description=f"{command.help[0].upper()}{command.help[1:]}.",
            epilog="\n".join(["examples:", *lines, "", EXIT_CODES]),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        for names, settings in (verbose, *command.arguments):
            parser.add_argument(*names, **settings)
    return main


class _Parser(argparse.ArgumentParser):
    """Parser that escapes control characters in its output and accepts negative angles as values."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # argparse itself recognises only single negative numbers

    def _print_message(self, message: str, file: Any = None) -> None:
        super()._print_message(printable(message), file)
