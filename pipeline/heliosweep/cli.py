"""The command line. Progress and messages go to standard error, answers to standard output."""

from __future__ import annotations

import argparse
import atexit
import gc
import io
import logging
import os
import re
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from heliosweep import __version__
from heliosweep.errors import HeliosweepError, Problem, RunInterrupted, StudyError, printable
from heliosweep.runs.signals import ignore_interruptions, interruptible
from heliosweep.share.command_lines import epilog_of

if TYPE_CHECKING:
    from heliosweep.config.study import Study

log = logging.getLogger("heliosweep")

_EXIT_CODES = """\
exit codes: 0 done, 2 wrong study or usage, 3 refused by the plan (would not fit), 4 interrupted but resumable,
1 anything else, and for verify and compare: not all right, not the same"""

#: How negative angles begin.
_NEGATIVE = re.compile(r"-\.?\d")

#: Formats of figures; pages are made of the first, which is always there.
_FIGURES = ("png", "svg", "pdf")

#: Objects that are made between two runs of Python's garbage collector, which has 700: imports leave 200,000, and to
#: look at each again and again takes a fifth of the time of ``plan``.
_BETWEEN_COLLECTIONS = 100_000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command, by default that of this process, and return its exit code."""
    _print_anything()
    if arguments is None:
        gc.set_threshold(_BETWEEN_COLLECTIONS)
        atexit.register(gc.freeze)
    # Results are written under names of their own and held by a claim; not every file system has HDF5's locks.
    os.environ.setdefault("HDF5_USE_FILE_LOCKING", "FALSE")
    given, parser = sys.argv[1:] if arguments is None else list(arguments), _parser()
    if not given:
        parser.print_help(sys.stderr)
        return 2
    options = parser.parse_args(_joined(given))
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Printable("%(message)s"))
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    logging.getLogger("heliosweep").setLevel(logging.DEBUG if options.verbose else logging.INFO)
    with interruptible():
        return _exit_code(options, ends_process=arguments is None)


def _exit_code(options: argparse.Namespace, *, ends_process: bool) -> int:
    """Carry out a command, and say what went wrong."""
    try:
        return options.command(options) or 0
    except (RunInterrupted, KeyboardInterrupt) as stop:
        warnings.filterwarnings("ignore", ".* was never awaited", RuntimeWarning)  # what an interruption tore in Zarr
        if ends_process:
            ignore_interruptions()  # a second Ctrl-C shall not change how a process ends that is ending
        _say(str(stop) or "interrupted", sys.stderr)
        return RunInterrupted.exit_code
    except BrokenPipeError:
        # The reader of our output (head, less) went away: not an error of ours.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (HeliosweepError, OSError) as error:
        if options.verbose and isinstance(error, OSError):
            raise
        return _refused(error)


def _refused(error: HeliosweepError | OSError, study: str = "") -> int:
    """Say why a command, or one study of several, was not carried out; its exit code."""
    if isinstance(error, OSError):
        _say(f"{_of(study)}{error.strerror or error}: {error.filename or ''}".rstrip(": "), sys.stderr)
        return 1
    print(error if study in str(error) else f"{printable(_of(study))}{error}", file=sys.stderr)
    if isinstance(error, StudyError) and len(error.problems) > 1:
        print(f"{error.count:,} problems found; nothing was written", file=sys.stderr)
    return error.exit_code


def _of(study: str) -> str:
    """How a message begins that is about one study of several."""
    return f"{study}: " if study else ""


class _Printable(logging.Formatter):
    """Messages in which nothing is left that a terminal would obey; of several studies, with the one that runs."""

    study = ""

    def format(self, record: logging.LogRecord) -> str:
        return printable(_of(self.study) + super().format(record))


def _say(text: object, file: Any = None) -> None:
    """Print text that may hold names and titles of anybody."""
    print(printable(text), file=file)


def _say_path(path: Any) -> None:
    """Print a path: as it is for another program, so that it is found there."""
    print(printable(path) if sys.stdout.isatty() else path)


def _print_anything() -> None:
    """Let text that the terminal cannot show be printed as escapes."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


class _Parser(argparse.ArgumentParser):
    def _print_message(self, message: str, file: Any = None) -> None:
        super()._print_message(printable(message), file)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="heliosweep",
        description="Batch studies of solar-concentrator tracking and optics: from a YAML file to a NetCDF data set.",
        epilog=_EXIT_CODES,
    )
    parser.add_argument("--version", action="version", version=f"heliosweep {__version__}")
    common = _Parser(add_help=False)
    common.add_argument("-v", "--verbose", action="store_true", help="say what is going on, and how long it takes")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    def command(name: str, action: Callable[[argparse.Namespace], int | None], text: str) -> argparse.ArgumentParser:
        description = text[0].upper() + text[1:] + "."
        raw = argparse.RawDescriptionHelpFormatter
        epilog = f"{epilog_of(name)}\n\n{_EXIT_CODES}"
        sub = commands.add_parser(
            name, help=text, description=description, epilog=epilog, parents=[common], formatter_class=raw
        )
        sub.set_defaults(command=action)
        return sub

    validate = command("validate", _validate, "check study files and list every problem at its line")
    validate.add_argument("studies", nargs="+", metavar="STUDY.yaml")
    _set_argument(validate)

    plan = command("plan", _plan, "say what a study will cost before it runs")
    plan.add_argument("study", metavar="STUDY.yaml")
    _run_arguments(plan)

    run = command(
        "run", _run, "run studies, or go on with them, and leave their result folders; prints the path of each result"
    )
    run.add_argument("studies", nargs="+", metavar="STUDY.yaml")
    _run_arguments(run)
    run.add_argument("--force", action="store_true", help="compute everything anew, whatever is there")
    run.add_argument("--no-report", action="store_true", help="leave out figures and the HTML page")
    run.add_argument("-q", "--quiet", action="store_true", help="show neither progress nor headline numbers")

    status = command("status", _status, "say what is done, failed and left, and how long it will take")
    status.add_argument("of", nargs="*", metavar="STUDY.yaml|DIR", help="studies or result folders (default: outputs/)")

    verify = command("verify", _verify, "check result folders against their digests, part by part")
    verify.add_argument("folders", nargs="+", metavar="DIR|STUDY.yaml", help="result folders, or studies that were run")

    compare = command("compare", _compare, "tell two results apart by meaning, or write one page over several")
    compare.add_argument("first", metavar="A", help="result folder, NetCDF file or Zarr folder; a study that was run")
    compare.add_argument("others", metavar="B", nargs="+", help="one, or with --page several")
    compare.add_argument(
        "--page", metavar="FILE.html", help="write a page: inputs, results, differences from A; prints its path"
    )
    compare.add_argument("--force", action="store_true", help="replace a page that is there")
    compare.add_argument("--rtol", type=_tolerance, default=0.0, help="relative difference that does not count")
    compare.add_argument("--atol", type=_tolerance, default=0.0, help="absolute difference that does not count")

    export = command("export", _export, "write a Zarr result as one NetCDF file, or a result as CSV; prints its path")
    export.add_argument("source", metavar="DIR", help="result folder, or its result.zarr")
    export.add_argument("-o", "--output", metavar="FILE.nc", help="file to write (default: export.nc beside it)")
    export.add_argument("--compression", choices=("none", "zlib"), default="none", help="of time series")
    export.add_argument("--force", action="store_true", help="replace a file that is there")
    export.add_argument("--csv", metavar="FILE.csv", help="write variables as a table instead, a row for each point")
    export.add_argument(
        "--variable", metavar="NAME", action="append", help="of the table, may be repeated (default: all, if they fit)"
    )

    convert = command(
        "convert",
        _convert,
        "write the layout of a study, result, file or PAINT folder as SolarPILOT or heliosweep has it",
    )
    convert.add_argument("source", metavar="STUDY.yaml|FIELD.csv|DIR")
    convert.add_argument("target", metavar="FILE.csv")
    convert.add_argument(
        "--to",
        choices=("solarpilot", "csv", "spots"),
        help="form of the file (default: solarpilot; csv of a PAINT folder); spots: those measured, of a PAINT folder",
    )
    convert.add_argument(
        "--select", metavar="KEY=VALUE", type=_choice, action="append", default=[], help="of a result with several"
    )
    convert.add_argument("--aim", metavar="NAME", default="receiver", help="target of a PAINT folder (receiver)")
    convert.add_argument("--force", action="store_true", help="replace a file that is there")

    table = command("table", _table, "write a field's efficiency over directions of the sun, for SAM or SolarPILOT")
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
    table.add_argument("--select", metavar="KEY=VALUE", type=_choice, action="append", default=[], help="what is swept")
    table.add_argument("--factor", type=float, default=1.0, help="what is not computed, as absorptance, 0 to 1")
    table.add_argument("--flux-maps", metavar="FILE.csv", help="write the flux maps of SAM's power tower too")
    table.add_argument("--force", action="store_true", help="replace a file that is there")

    report = command("report", _report, "draw the figures and the HTML page of a result folder again")
    report.add_argument("folder", metavar="DIR|STUDY.yaml", help="result folder, or a study that was run")
    formats = ", ".join(_FIGURES)
    report.add_argument(
        "--format",
        type=_formats,
        default=(),
        metavar="LIST",
        help=f"formats of the figures, of {formats} (default: png)",
    )

    pack = command("pack", _pack, "write a finished result as one archive to publish and cite; prints its path")
    pack.add_argument(
        "folders", metavar="DIR|STUDY.yaml", nargs="+",
        help="result folders, or studies that were run; several become a collection",
    )  # fmt: skip
    pack.add_argument("-o", "--output", metavar="FILE.zip", help="archive to write (default: DIR.zip)")
    pack.add_argument("--license", metavar="SPDX", help="licence of the data (default: dataset.license of the study)")
    pack.add_argument("--draft", action="store_true", help="pack without creators or licence too, to look at it")
    pack.add_argument("--force", action="store_true", help="replace an archive that is there")

    new = command("new", _new, "write a commented study file to start from; prints its path")
    new.add_argument("family", metavar="FAMILY")
    new.add_argument("file", nargs="?", metavar="FILE.yaml", help="file to write (default: FAMILY.yaml)")
    new.add_argument("--force", action="store_true", help="replace a file that is there")

    explain = command("explain", _explain, "say what a key of study files means, its unit, range, default and forms")
    explain.add_argument("of", nargs="+", metavar="[FAMILY] KEY", help="as receiver.height; a family lists its keys")

    examples = command("examples", _examples, "list the studies that come with heliosweep, or copy some")
    examples.add_argument("names", nargs="*", metavar="NAME", help="studies to copy, with the files that they name")
    examples.add_argument("--to", metavar="DIR", default=".", help="folder to copy to (default: here)")
    examples.add_argument("--force", action="store_true", help="replace files that are there")

    schema = command("schema", _schema, "print a family's JSON Schema, for editors")
    schema.add_argument("family", metavar="FAMILY")

    command("families", _families, "list the study families")
    return parser


def _set_argument(parser: argparse.ArgumentParser) -> None:
    text = "another value of a key of the study, may be repeated; null takes the key away"
    parser.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], help=text)


def _run_arguments(parser: argparse.ArgumentParser) -> None:
    _set_argument(parser)
    parser.add_argument("-o", "--output", metavar="DIR", help="result folder (default: outputs/<study>-<id>)")
    parser.add_argument(
        "--scheduler",
        metavar="WHERE",
        help="where the work runs: threads, processes, synchronous, distributed, tcp://HOST:PORT, slurm, ...",
    )
    parser.add_argument("--workers", metavar="N", help="blocks that run at a time (default: all cores)")
    parser.add_argument("--memory", metavar="SIZE", help='memory the run may use, as "2 GB" (default: what is free)')
    parser.add_argument("--profile", metavar="NAME", help="which of the study's execution.profiles is used")


def _tolerance(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a number, 0 or more (got {text})")
    return value


def _joined(arguments: Sequence[str]) -> list[str]:
    """Join angles that begin with a minus to their option, for argparse takes them for another one."""
    joined: list[str] = []
    for text in arguments:
        if joined and joined[-1] in ("--azimuth", "--elevation") and _NEGATIVE.match(text):
            joined[-1] += f"={text}"
        else:
            joined.append(text)
    return joined


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
    wrong = [part for part in given if part not in _FIGURES]
    if wrong:
        raise argparse.ArgumentTypeError(f"must be of {', '.join(_FIGURES)}, with commas between (got {text})")
    return given


def _load(options: argparse.Namespace, path: str) -> Study:
    """Load a study with what the command line says of it and of its execution, and pass on its warnings."""
    from heliosweep import api
    from heliosweep.config.layers import OPTION, settings

    study = api.load(path, settings(options.set), named=OPTION)
    execution = study.execution.resolved(options.profile).model_copy(update=_asked(options))
    _warn(study)
    return study.model_copy(update={"execution": execution})


def _asked(options: argparse.Namespace) -> dict[str, Any]:
    """Keys of ``execution`` that the command line gives, read as those of a study file are."""
    from heliosweep.config.layers import execution_keys

    return execution_keys({name: getattr(options, name) for name in ("scheduler", "workers", "memory")}, "--")


def _warn(study: Study) -> None:
    for note in study.notes():
        _say(f"{_of(_Printable.study)}warning: {note}", sys.stderr)


def _validate(options: argparse.Namespace) -> int:
    from heliosweep import api
    from heliosweep.config.layers import OPTION, settings

    code, changes = 0, settings(options.set)
    for path in options.studies:
        try:
            study = api.load(path, changes, named=OPTION)
        except StudyError as error:
            print(error, file=sys.stderr)
            code = error.exit_code
        else:
            _warn(study)
            _say(f"{path}: valid {study.family} study {study.study_id}")
    return code


def _plan(options: argparse.Namespace) -> None:
    from heliosweep import api
    from heliosweep.runs.status import plan_text

    study = _load(options, options.study)
    folder = api.result_folder(study, options.output)
    _say(plan_text(study, api.plan(study, folder), folder))


def _run(options: argparse.Namespace) -> int:
    several = len(options.studies) > 1
    if several and options.output is not None:
        raise StudyError(Problem("names the folder of one study; name one, or leave it out", "--output"))
    _asked(options)  # once, where it is wrong
    failed: dict[str, int] = {}
    for path in options.studies:
        _Printable.study = path if several else ""
        try:
            _run_one(options, path)
        except (RunInterrupted, BrokenPipeError):
            raise
        except Exception as error:  # whatever befalls one study, the others go on
            if not several:
                raise
            if isinstance(error, HeliosweepError | OSError) and not (options.verbose and isinstance(error, OSError)):
                failed[path] = _refused(error, path)
            else:
                log.exception("failed")
                failed[path] = 1
        finally:
            _Printable.study = ""
    if failed:
        _say(f"{len(failed)} of {len(options.studies)} studies failed: {', '.join(failed)}", sys.stderr)
    codes = {0, *failed.values()}
    return max(codes) if len(codes) < 3 else 1


def _run_one(options: argparse.Namespace, path: str) -> None:
    from heliosweep import api

    study = _load(options, path)
    result = api.run(
        study, options.output, progress=not options.quiet, report=not options.no_report, force=options.force
    )
    if not options.quiet and (told := result.ending()):
        _say(told, sys.stderr)
    _say_path(result.path)


def _status(options: argparse.Namespace) -> None:
    from heliosweep import api
    from heliosweep.runs.status import status_lines
    from heliosweep.store.folder import OUTPUTS

    found = api.status(*options.of)
    _say("\n".join(status_lines(found)) or f"no study was run in {OUTPUTS}/ yet")


def _verify(options: argparse.Namespace) -> int:
    from heliosweep import api
    from heliosweep.runs.verify import verify

    code = 0
    for place in options.folders:
        found = verify(api.folder_of(place, there=True))
        _say(found.text)
        code = code if found.ok else 1
    return code


def _compare(options: argparse.Namespace) -> int:
    from heliosweep import api
    from heliosweep.store.compare import compare

    places = [api.folder_of(place, there=True) for place in (options.first, *options.others)]
    if options.page is not None:
        from heliosweep.notebook import comparison_page

        _say_path(comparison_page(places, options.page, force=options.force))
        return 0
    if len(places) > 2:
        raise StudyError(Problem("compares more than two: name the page to write", "--page"))
    found = compare(*places, rtol=options.rtol, atol=options.atol)
    _say(found.text)
    return 0 if found.same else 1


def _export(options: argparse.Namespace) -> None:
    if options.csv is not None:
        from heliosweep import api
        from heliosweep.share.frames import write_csv
        from heliosweep.store.checks import blaming_damage, sound
        from heliosweep.store.targets import target_file

        target_file(options.csv, options.force, sources=_read_for(options.source))
        sound(options.source, as_written=True)
        with blaming_damage(options.source), api.open_result(options.source) as result:
            _say_path(write_csv(result, options.csv, options.variable, force=options.force))
        return
    if options.variable:
        raise StudyError(Problem("is for --csv", "--variable"))
    from heliosweep.store.result import export

    _say_path(export(options.source, options.output, compression=options.compression, force=options.force))


def _read_for(source: str) -> set[Any]:
    """Files that a study file, a layout or a result folder stands for, as far as they can be told."""
    from heliosweep import api
    from heliosweep.files import user_path
    from heliosweep.store.folder import refuse_devices
    from heliosweep.store.targets import sources_of

    files, path = {user_path(source)}, user_path(source)
    if path.is_dir():
        refuse_devices(path)
        path = path / "study.resolved.yaml"
    if path.suffix.lower() in (".yaml", ".yml"):
        with suppress(HeliosweepError, OSError):  # whoever needs the study says what is wrong with it
            files |= sources_of(api.load(path))
    return files


def _convert(options: argparse.Namespace) -> None:
    from heliosweep import api
    from heliosweep.files import user_path
    from heliosweep.share import fields
    from heliosweep.store.targets import target_file

    target_file(options.target, options.force, sources=_read_for(options.source))
    is_folder = user_path(options.source).is_dir()
    if options.to == "spots":
        spots = fields.read_paint_spots(options.source, options.aim)
        _say_path(fields.write_paint_spots(spots, options.target, force=options.force))
        return
    if is_folder and (user_path(options.source) / "manifest.json").exists():
        with api.open_result(options.source) as result:
            layout = fields.layout_of(result, dict(options.select))
    elif options.select:
        raise StudyError(Problem("is for a result folder", "--select"))
    elif is_folder:
        layout = fields.read_paint(options.source, options.aim).layout
    elif options.source.lower().endswith((".yaml", ".yml")):
        layout = fields.layout_of(api.load(options.source))
    else:
        layout = fields.read_layout(options.source)
    form: Any = options.to or ("csv" if is_folder else "solarpilot")
    _say_path(fields.write_layout(layout, options.target, form, force=options.force))


def _table(options: argparse.Namespace) -> None:
    from heliosweep.notebook import efficiency_table, flux_maps
    from heliosweep.share.sam import write_table
    from heliosweep.store.targets import target_file

    # Before anything is computed.
    read, maps = _read_for(options.source), options.flux_maps
    file = target_file(options.output, options.force, sources=read)
    if maps is not None:
        target_file(maps, options.force, sources={*read, file})
        if options.form != "tower":
            raise StudyError(Problem("are for --form tower", "--flux-maps"))
    said: dict[str, Any] = {"select": dict(options.select), "azimuth": options.azimuth, "elevation": options.elevation}
    table = efficiency_table(options.source, **said, factor=options.factor)
    shares = None if maps is None else flux_maps(options.source, **said)
    _say_path(write_table(table, options.output, options.form, force=options.force))
    if shares is not None:
        _say_path(write_table(shares, maps, force=options.force))


def _report(options: argparse.Namespace) -> None:
    from heliosweep import api

    _say_path(
        api.report(api.folder_of(options.folder, there=True), vector=[kind for kind in options.format if kind != "png"])
    )


def _pack(options: argparse.Namespace) -> None:
    from heliosweep import api
    from heliosweep.share.archive import pack_result

    folders = [api.folder_of(folder, there=True) for folder in options.folders]
    said = {"license": options.license, "draft": options.draft, "force": options.force}
    _say_path(pack_result(folders, options.output, **said))


def _new(options: argparse.Namespace) -> None:
    from heliosweep.share.guide import new_study

    _say_path(new_study(options.family, options.file, force=options.force))


def _explain(options: argparse.Namespace) -> None:
    from heliosweep.share.guide import explain

    _say(explain(options.of))


def _examples(options: argparse.Namespace) -> None:
    from heliosweep.share.guide import copy_examples, examples

    if not options.names:
        _say(examples())
        return
    for path in copy_examples(options.names, options.to, force=options.force):
        _say_path(path)


def _schema(options: argparse.Namespace) -> None:
    from heliosweep.families.family import families

    known = families()
    if options.family not in known:
        raise StudyError(Problem(f"unknown family; the families are {', '.join(known)}", options.family))
    import json

    from heliosweep.config.study import json_schema

    print(json.dumps(json_schema(known[options.family].study_class()), indent=2))


def _families(_: argparse.Namespace) -> None:
    from heliosweep.families.family import families

    width = max(map(len, families()))
    for name, family in families().items():
        print(f"{name:{width}}  {family.title}")
