"""What may follow ``heliosweep``: commands, their options, and examples of each."""

from __future__ import annotations

import argparse
import re
from typing import Any

from heliosweep import __version__
from heliosweep.errors import printable

EXIT_CODES = """\
exit codes: 0 done, 2 wrong study or usage, 3 refused by the plan (would not fit), 4 interrupted but resumable,
1 anything else, and for verify and compare: not all right, not the same"""

#: Formats of figures; pages are made of the first, which is always there.
FIGURES = ("png", "svg", "pdf")

#: How values begin that are no options: argparse knows single numbers alone.
_NEGATIVE = re.compile(r"-\.?\d")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line; of what it has parsed, `command` is the name of the command."""
    main = _Parser(
        prog="heliosweep",
        description="Batch studies of solar-concentrator tracking and optics: from a YAML file to a NetCDF data set.",
        epilog=EXIT_CODES,
    )
    main.add_argument("--version", action="version", version=f"heliosweep {__version__}")
    common = _Parser(add_help=False)
    common.add_argument("-v", "--verbose", action="store_true", help="say what is going on, and how long it takes")
    commands = main.add_subparsers(title="commands", metavar="COMMAND", dest="command", required=True)

    def command(name: str, text: str, *examples: str) -> argparse.ArgumentParser:
        lines = [f"  heliosweep {name} {line}".rstrip() for line in examples]
        return commands.add_parser(
            name,
            help=text,
            description=f"{text[0].upper()}{text[1:]}.",
            epilog="\n".join(["examples:", *lines, "", EXIT_CODES]),
            parents=[common],
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    validate = command(
        "validate",
        "check study files and list every problem at its line",
        "my_field.yaml",
        "studies/*.yaml",
        "my_field.yaml --set receiver.height=90",
    )
    validate.add_argument("studies", nargs="+", metavar="STUDY.yaml")
    _add_set(validate)

    plan = command(
        "plan",
        "say what a study will cost before it runs",
        "my_field.yaml",
        'my_field.yaml --set "site.latitude=[0, 20, 40]"',
    )
    plan.add_argument("study", metavar="STUDY.yaml")
    _add_execution(plan)

    run = command(
        "run",
        "run studies, or go on with them, and leave their result folders; prints the path of each result",
        "my_field.yaml",
        "my_field.yaml --set receiver.height=90 --set tracking=azimuth_elevation",
        "my_field.yaml --output results/first --scheduler processes --workers 4",
    )
    run.add_argument("studies", nargs="+", metavar="STUDY.yaml")
    _add_execution(run)
    _add_force(run, "compute everything anew, whatever is there")
    run.add_argument("--no-report", action="store_true", help="leave out figures and the HTML page")
    run.add_argument("-q", "--quiet", action="store_true", help="show neither progress nor headline numbers")

    status = command("status", "say what is done, failed and left, and how long it will take", "", "my_field.yaml")
    status.add_argument("of", nargs="*", metavar="STUDY.yaml|DIR", help="studies or result folders (default: outputs/)")

    verify = command("verify", "check result folders against their SHA-256", "my_field.yaml", "outputs/*/")
    verify.add_argument("folders", nargs="+", metavar="DIR|STUDY.yaml", help="result folders, or studies that were run")

    compare = command(
        "compare",
        "tell two results apart by meaning, or write one page over several",
        "outputs/first outputs/second",
        "first.nc second.nc --rtol 1e-9",
        "low.yaml middle.yaml high.yaml --page heights.html",
    )
    compare.add_argument("first", metavar="A", help="result folder, NetCDF file or Zarr folder; a study that was run")
    compare.add_argument("others", metavar="B", nargs="+", help="one, or with --page several")
    compare.add_argument(
        "--page", metavar="FILE.html", help="write a page: inputs, results, differences from A; prints its path"
    )
    _add_force(compare, "replace a page that is there")
    compare.add_argument("--rtol", type=_tolerance, default=0.0, help="relative difference that does not count")
    compare.add_argument("--atol", type=_tolerance, default=0.0, help="absolute difference that does not count")

    export = command(
        "export",
        "write a result as tables for Excel, as CSV, or a Zarr result as one NetCDF file; prints its path",
        "my_field.yaml -o numbers.xlsx",
        "outputs/first -o table.csv --variable field_optical_efficiency",
        "outputs/first -o whole.nc",
    )
    export.add_argument("source", metavar="DIR|STUDY.yaml", help="result folder, or a study that was run")
    export.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help="file to write, .xlsx, .csv or .nc (default: export.nc beside the result)",
    )
    export.add_argument("--csv", dest="output", metavar="FILE.csv", help=argparse.SUPPRESS)
    export.add_argument(
        "--variable",
        metavar="NAME",
        action="append",
        help="of a table, may be repeated (default: all; of CSV if they have the same dimensions)",
    )
    export.add_argument("--compression", choices=("none", "zlib"), default="none", help="of time series in NetCDF")
    _add_force(export)

    convert = command(
        "convert",
        "write the layout of a study, result, file or PAINT folder as SolarPILOT or heliosweep has it",
        "my_field.yaml positions.csv",
        "positions.csv field.csv --to csv",
    )
    convert.add_argument("source", metavar="STUDY.yaml|FIELD.csv|DIR")
    convert.add_argument("target", metavar="FILE.csv")
    convert.add_argument(
        "--to",
        choices=("solarpilot", "csv", "spots"),
        help="form of the file (default: solarpilot; csv of a PAINT folder); spots: those measured, of a PAINT folder",
    )
    _add_select(convert, "of a result with several")
    convert.add_argument("--aim", metavar="NAME", default="receiver", help="target of a PAINT folder (receiver)")
    _add_force(convert)

    table = command(
        "table",
        "write a field's efficiency over directions of the sun, for SAM or SolarPILOT",
        "my_field.yaml -o efficiency.csv --azimuth 0:345:15 --elevation 5:85:10",
    )
    table.add_argument("source", metavar="STUDY.yaml|DIR")
    table.add_argument("-o", "--output", metavar="FILE.csv", required=True, help="file to write")
    table.add_argument(
        "--form",
        choices=("tower", "generic", "solarpilot"),
        default="tower",
        help="for SAM's power tower (default) or generic solar field, or as SolarPILOT writes it",
    )
    angles = "in deg, as 0,30,60 or START:STOP:STEP"
    table.add_argument("--azimuth", type=_angles, help=f"of the sun, from north, clockwise, {angles} (0:360:15)")
    table.add_argument("--elevation", type=_angles, help=f"of the sun, {angles} (0:90:5)")
    _add_select(table, "what is swept")
    table.add_argument("--factor", type=float, default=1.0, help="what is not computed, as absorptance, 0 to 1")
    table.add_argument("--flux-maps", metavar="FILE.csv", help="write the flux maps of SAM's power tower too")
    _add_force(table)

    report = command(
        "report",
        "draw the figures and the HTML page of a result folder again",
        "my_field.yaml",
        "outputs/first --format png,svg,pdf",
    )
    report.add_argument("folder", metavar="DIR|STUDY.yaml", help="result folder, or a study that was run")
    report.add_argument("--summary", action="store_true", help="write summary.html, which prints on one page")
    formats = ", ".join(FIGURES)
    report.add_argument(
        "--format",
        type=_formats,
        default=(),
        metavar="LIST",
        help=f"formats of the figures, of {formats} (default: png)",
    )

    pack = command(
        "pack",
        "write a finished result as one archive to publish and cite; prints its path",
        "my_field.yaml",
        "outputs/first -o first.zip --license CC0-1.0",
    )
    pack.add_argument(
        "folders",
        metavar="DIR|STUDY.yaml",
        nargs="+",
        help="result folders, or studies that were run; several become a collection",
    )
    pack.add_argument("-o", "--output", metavar="FILE.zip", help="archive to write (default: DIR.zip)")
    pack.add_argument("--license", metavar="SPDX", help="licence of the data (default: dataset.license of the study)")
    pack.add_argument("--draft", action="store_true", help="pack also without creators or licence")
    pack.add_argument("--ro-crate", action="store_true", help="add RO-Crate metadata (needs the extra 'crate')")
    _add_force(pack, "replace an archive that is there")

    new = command(
        "new",
        "write a commented study file to start from; prints its path",
        "field_efficiency",
        "dish_tracking my_dish.yaml",
    )
    new.add_argument("family", metavar="FAMILY")
    new.add_argument("file", nargs="?", metavar="FILE.yaml", help="file to write (default: FAMILY.yaml)")
    _add_force(new)

    explain = command(
        "explain",
        "explain a key of study files (unit, range, default, forms) or a variable of results",
        "receiver.height",
        "field_receiver_energy",
        "field_efficiency optics",
        "field_efficiency",
    )
    explain.add_argument(
        "of", nargs="+", metavar="[FAMILY] KEY", help="such as receiver.height; a family lists its keys"
    )

    examples = command(
        "examples",
        "list the studies that come with heliosweep, or copy some",
        "",
        "chong2012_table2 --to studies",
    )
    examples.add_argument("names", nargs="*", metavar="NAME", help="studies to copy, with the files that they name")
    examples.add_argument("--to", metavar="DIR", default=".", help="folder to copy to (default: here)")
    _add_force(examples, "replace files that are there")

    command("setup", "compile all kernels, so that no study waits for them", "")

    schema = command("schema", "print a family's JSON Schema, for editors", "field_efficiency")
    schema.add_argument("family", metavar="FAMILY")

    command("families", "list the study families", "")
    return main


class _Parser(argparse.ArgumentParser):
    """Prints nothing that a terminal would obey, and takes angles that begin with a minus for values."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._negative_number_matcher = _NEGATIVE

    def _print_message(self, message: str, file: Any = None) -> None:
        super()._print_message(printable(message), file)


def _add_set(parser: argparse.ArgumentParser) -> None:
    text = "another value of a key of the study, may be repeated; null takes the key away"
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], help=text)


def _add_execution(parser: argparse.ArgumentParser) -> None:
    _add_set(parser)
    parser.add_argument("-o", "--output", metavar="DIR", help="result folder (default: outputs/<study>-<id>)")
    parser.add_argument(
        "--scheduler",
        metavar="WHERE",
        help="where the work runs: threads, processes, synchronous, distributed, tcp://HOST:PORT (default: threads)",
    )
    parser.add_argument("--workers", metavar="N", help="blocks that run at a time (default: all cores)")
    parser.add_argument("--memory", metavar="SIZE", help='memory the run may use, as "2 GB" (default: what is free)')
    parser.add_argument("--profile", action=_Removed, help=argparse.SUPPRESS)


class _Removed(argparse.Action):
    """Option of an earlier version."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        parser.error("--profile was removed; write --set execution.KEY=VALUE, or include a file with these keys")


def _add_select(parser: argparse.ArgumentParser, text: str) -> None:
    parser.add_argument("--select", metavar="KEY=VALUE", type=_choice, action="append", default=[], help=text)


def _add_force(parser: argparse.ArgumentParser, text: str = "replace a file that is there") -> None:
    parser.add_argument("--force", action="store_true", help=text)


def _tolerance(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a number, 0 or more (got {text})")
    return value


def _angles(text: str) -> Any:
    """Numbers of a list or of a range, as a study has them."""
    try:
        if ":" in text:
            return dict(zip(("start", "stop", "step"), map(float, text.split(":")), strict=True))
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be numbers as 0,30,60 or START:STOP:STEP (got {text})") from None


def _choice(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise argparse.ArgumentTypeError(f"must be KEY=VALUE (got {text})")
    return name.strip(), value.strip()


def _formats(text: str) -> tuple[str, ...]:
    given = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",")))
    wrong = [part for part in given if part not in FIGURES]
    if wrong:
        raise argparse.ArgumentTypeError(f"must be of {', '.join(FIGURES)}, with commas between (got {text})")
    return given
