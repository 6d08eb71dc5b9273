"""Digest of the code that numbers depend on, without the words about it.

Of a module counts its syntax tree, and those of the modules that it imports from this package and from its own. Left
out are comments, docstrings, `__all__`, what errors are raised with, and annotations of functions; those of fields
stay, for models read units from them. Modules that hold words alone are not followed.
"""

import ast
import hashlib
import importlib.util
import json
import os
import re
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

__all__ = ["code_versions", "installed", "numbers_digest", "version_of"]

_PACKAGE = "heliosweep"
_WORDS = (
    "accessor",
    "api",
    "cli",
    "config.dataset",
    "config.faults",
    "errors",
    "files",
    "notebook",
    "report",
    "runs",
    "share",
    "store",
)
"""Modules and folders of the package on which no number depends, unless they are asked for by name."""
_KEPT = 2000
"""Files whose code is remembered."""
_ENCODING = "heliosweep.store.encoding"
"""How values are stored."""
_LIBRARIES = ("numpy", "numba", "llvmlite", "scipy", "pandas", "pvlib", "pillow", "tzdata")
"""Packages that numbers go through; xarray and dask only carry them."""

_Imports = list[list[str]]
"""Of each import the modules that it could mean, the most likely first; relative ones begin with dots."""


@cache
def code_versions(*modules: str) -> dict[str, str]:
    """Version of everything that can change a number that these modules of a family compute.

    ``heliosweep`` is the digest of their code and of all that they import from this package and their own; the others
    are versions of libraries.
    """
    digest = numbers_digest(*modules, _ENCODING)
    return {"heliosweep": digest[:16], **{name: version_of(name) or "missing" for name in _LIBRARIES}}


def version_of(library: str) -> str | None:
    """Version of an installed library; None where there is none."""
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None


def installed() -> dict[str, str]:
    """Versions of this package and of all that it needs, and that in turn, as far as they are installed."""
    found: dict[str, str] = {}
    waiting = [_PACKAGE]
    while waiting:
        if (one := waiting.pop()) in found:
            continue
        with suppress(metadata.PackageNotFoundError):
            said = metadata.metadata(one)  # read once: it takes a millisecond
            found[one] = said["Version"]
            needed = (text for text in said.get_all("Requires-Dist") or () if "extra ==" not in text)
            waiting += (re.split(r"[^A-Za-z0-9._-]", text, maxsplit=1)[0].lower().replace("_", "-") for text in needed)
    return dict(sorted(found.items()))


def numbers_digest(*modules: str, root: Path | None = None) -> str:
    """Digest of what the numbers that some modules compute depend on; of the files as they were when first read.

    Parameters
    ----------
    *modules : str
        Dotted names.
    root : Path, optional
        Folder that holds the packages; otherwise they are where Python finds them.

    Returns
    -------
    str
        SHA-256 in hexadecimal digits, over the names and the code of these modules and of all that they import.

    Raises
    ------
    ModuleNotFoundError
        Where one of the modules has no source file.
    """
    known = len(_memory())
    found: dict[str, str] = {}
    waiting = list(modules)
    while waiting:
        if (name := waiting.pop()) not in found:
            found[name], imported = _module(name, root)
            waiting += imported
    if len(_memory()) > known:
        _remember()
    return hashlib.sha256(json.dumps(sorted(found.items())).encode()).hexdigest()


@cache
def _module(name: str, root: Path | None) -> tuple[str, list[str]]:
    """Digest of a module's code, and the modules of its package and of this one that it imports, but those of words."""
    path = _source(name, root)
    if path is None:
        raise ModuleNotFoundError(f"no source file of {name}", name=name)
    text = path.read_bytes()
    key = hashlib.sha256(text + _own_source()).hexdigest()
    if key not in _memory():
        _memory()[key] = _code(text)
    digest, imports = _memory()[key]
    package = name if path.stem == "__init__" else name.rpartition(".")[0]
    followed = []
    for candidates in imports:
        for each in candidates:
            other = importlib.util.resolve_name(each, package)
            if other.partition(".")[0] in (_PACKAGE, package.partition(".")[0]) and _source(other, root) is not None:
                if not f"{other}.".startswith(tuple(f"{_PACKAGE}.{word}." for word in _WORDS)):
                    followed.append(other)
                break
    return digest, followed


@cache
def _source(name: str, root: Path | None) -> Path | None:
    """File of a module."""
    top, *inner = name.split(".")
    place = (root or _folder_of(top)).joinpath(top, *inner)
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)


@cache
def _folder_of(top: str) -> Path:
    """Folder that holds a package or module of the first level."""
    if top == _PACKAGE:
        return Path(__file__).parents[1]
    try:
        spec = importlib.util.find_spec(top)
    except ValueError:  # a program, which was never imported
        spec = None
    if spec is None or not (place := [*(spec.submodule_search_locations or []), spec.origin][0]):
        raise ModuleNotFoundError(f"no source file of {top}", name=top)
    return Path(place).parent


def _code(text: bytes) -> tuple[str, _Imports]:
    """Digest of the code in a file, and what it imports."""
    tree = _WithoutWords().visit(ast.parse(text))
    imports: _Imports = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += ([alias.name] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            dot = "" if base.endswith(".") else "."
            imports += ([f"{base}{dot}{alias.name}", base] for alias in node.names)
    return hashlib.sha256(repr(_plain(tree)).encode()).hexdigest(), imports


class _WithoutWords(ast.NodeTransformer):
    """Takes from a syntax tree what no number depends on."""

    def visit_Expr(self, node: ast.Expr) -> Any:
        return None if isinstance(node.value, ast.Constant) else node

    def visit_Raise(self, node: ast.Raise) -> Any:
        exception = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
        return ast.Raise(exception, None)

    def visit_If(self, node: ast.If) -> Any:
        self.generic_visit(node)
        return node.orelse if ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING") else node

    def visit_arg(self, node: ast.arg) -> Any:
        return ast.arg(node.arg)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> Any:
        node.returns = None
        return self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> Any:
        return None if ast.unparse(node.targets[0]) == "__all__" else node


def _plain(node: Any) -> Any:
    """Syntax as nested tuples, the same in each version of Python: what a node has not is not told."""
    if isinstance(node, list):
        return [_plain(each) for each in node]
    if not isinstance(node, ast.AST):
        return node
    fields = ((name, getattr(node, name, None)) for name in node._fields if name not in ("ctx", "kind", "type_comment"))
    told = ((name, value) for name, value in fields if value is not None and value != [])
    return type(node).__name__, [(name, _plain(value)) for name, value in told]


@cache
def _own_source() -> bytes:
    return Path(__file__).read_bytes()


def _place() -> Path:
    """File that remembers code digests, beside what Python or numba remember: parsing takes 40 ms a thousand lines."""
    cached = Path(importlib.util.cache_from_source(__file__)).with_suffix(".json")
    folder = os.environ.get("NUMBA_CACHE_DIR")
    return Path(folder, f"{_PACKAGE}.{cached.name}") if folder else cached


@cache
def _memory() -> dict[str, tuple[str, _Imports]]:
    with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):
        said = json.loads(_place().read_text(encoding="utf-8"))
        if said["digest"] == _digest_of(said["files"]):  # else damaged
            return dict(said["files"])
    return {}


def _digest_of(files: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(files, sort_keys=True).encode()).hexdigest()


def _remember() -> None:
    place, content = _place(), dict([*_memory().items()][-_KEPT:])
    temporary = place.with_suffix(f".{os.getpid()}")
    with suppress(OSError):  # there may be no place for it
        place.parent.mkdir(parents=True, exist_ok=True)
        said = {"digest": _digest_of(content), "files": content}
        temporary.write_text(json.dumps(said), encoding="utf-8")
        temporary.replace(place)
