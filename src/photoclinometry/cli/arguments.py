"""From the command line's words to the call of a command: help in two lengths, ranges, and what was misspelt."""

from __future__ import annotations

import difflib
import functools
import importlib
import inspect
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import tyro

from photoclinometry import __version__
from photoclinometry.cli.first_options import FIRST
from photoclinometry.model.errors import InputError
from photoclinometry.model.ranges import OptionError, described

COMMANDS = {
    "ingest": "Make a site of archived images (PDS, ISIS, FITS, PNG, TIFF).",
    "calibrate": "Find the distortion of a site's cameras by its own images.",
    "views": "List the images that see a place, and choose some for a map.",
    "plan": "Foresee the map of planned images, and what one more adds.",
    "simulate": "Simulate the images of a place or body, with their truth.",
    "run": "Map a site: poses, dense landmarks, normals, albedo, report.",
    "body": "Map a whole body: overlapping maps, and one closed surface.",
    "refine": "Refine a text model of the paper's authors.",
    "render": "Render a map under the Sun of a view, or another one.",
    "evaluate": "Measure a map by its images, a truth or another map.",
    "photometry": "Rank reflectance models by how well they predict images.",
    "info": "Show what a site or a run folder holds.",
    "view": "Open a map in the browser.",
    "measure": "Measure distances, slopes and volumes of a map.",
    "figure": "Draw a figure for publication.",
    "export": "Export a map or a body as GeoTIFF, meshes, models, tables.",
    "fetch": "Fetch published sites from Hugging Face.",
    "study": "Simulate and map many sites, and tabulate their errors.",
    "rivals": "Compare a map with other published methods.",
}
"""The purpose of each command, in a line. Each is the function of its name in the module of `cli` of that name."""
ABOUT = """Poses, dense landmarks, normals and albedo of small bodies, from spacecraft images.

`phomo COMMAND --help` explains a command, and `phomo --version` prints the version."""

Command = Callable[..., Any]


class _Refused(Exception):
    """Options that could not be made, and why. Not a ValueError, which tyro would answer in words of its own."""

    def __init__(self, error: InputError):
        super().__init__(str(error))
        self.error = error


def call(arguments: Sequence[str] | None = None) -> None:
    """Calls the command that the arguments (by default the process's) name.

    Raises InputError for a command that there is not, and for values outside of an option's range; ends with exit code
    2 where options are wrong, as tyro does.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] in (["--version"], ["-V"]):
        print(f"phomo {__version__}")
    elif words and not words[0].startswith("-"):
        _call_one(words[0], words[1:])
    else:
        completes = any(word.startswith("--tyro-") for word in words)
        commands = {name: command_named(name) if completes else in_one_line(name) for name in COMMANDS}
        tyro.extras.subcommand_cli_from_dict(
            commands, prog="phomo", description=ABOUT, args=words, registry=registry_with()
        )


def command_named(name: str) -> Command:
    """The function of a command. Raises InputError for a name that is none, with the nearest that is."""
    if name not in COMMANDS:
        near = difflib.get_close_matches(name, COMMANDS, n=1)
        meant = f"did you mean `phomo {near[0]}`?" if near else f"commands: {', '.join(COMMANDS)}"
        raise InputError(f"there is no command {name!r}; {meant} (`phomo --help` explains them)")
    return getattr(importlib.import_module(f"photoclinometry.cli.{name}"), name)


def _call_one(name: str, words: list[str]) -> None:
    command = command_named(name)
    prepared = getattr(importlib.import_module(command.__module__), "prepared", None)
    function = prepared(words) if prepared else command
    about, registry = None, registry_with()
    if "--help-all" in words:
        words = ["--help"]
    elif name in FIRST and {"--help", "-h"} & set(words):
        words, registry = ["--help"], registry_with(first_fields(command, FIRST[name]))
        hidden = sum(1 for _ in option_fields(command)) - len(FIRST[name])
        about = f"{inspect.getdoc(command)}".split("\n\nArgs:")[0]
        about += f"\n\nThese options matter first; `phomo {name} --help-all` shows {hidden} more, and all in full."
    try:
        tyro.cli(function, prog=f"phomo {name}", description=about, args=words, registry=registry)
    except _Refused as refused:
        error = refused.error
        named = f"{option_name(command, error)} {error.problem}" if isinstance(error, OptionError) else str(error)
        raise InputError(named) from error


def in_one_line(name: str) -> Command:
    """A command with its line of COMMANDS as docstring, for the list of commands."""
    command = command_named(name)

    @functools.wraps(command)
    def told(*args: Any, **given: Any) -> Any:
        return command(*args, **given)

    told.__doc__ = COMMANDS[name]
    return told


def with_defaults(command: Command, name: str, value: Any) -> Command:
    """The command with another default of one of its arguments."""

    def changed(*args: Any, **given: Any) -> Any:
        return command(*args, **given)

    signature = inspect.signature(command)
    parts = [p.replace(default=value) if p.name == name else p for p in signature.parameters.values()]
    changed.__dict__ |= {"__wrapped__": command, "__signature__": signature.replace(parameters=parts)}
    changed.__doc__, changed.__name__ = command.__doc__, command.__name__
    return changed


def option_fields(command: Command) -> Iterator[tuple[str, type, str]]:
    """The options of a command that are fields of dataclasses: name as typed without dashes, class, field."""
    for name, hint in get_type_hints(command, include_extras=True).items():
        if is_dataclass(_bare(hint)):
            yield from _fields_below(_bare(hint), "" if _nameless(hint) else f"{name}.")


def option_name(command: Command, error: OptionError) -> str:
    """The option as a person types it for this command, such as --adjust.max-reweightings."""
    for name, kind, field in option_fields(command):
        if (kind, field) == (error.kind, error.field):
            return f"--{name.replace('_', '-')}"
    return f"{error.kind.__name__}.{error.field}"


def first_fields(command: Command, names: Sequence[str]) -> set[tuple[type, str]]:
    """The class and the field of each of the options named, and of the groups that they are in."""
    by_name = {name: (kind, field) for name, kind, field in option_fields(command)}
    groups = {(kind, field) for prefix, kind, field in _groups(command) if any(n.startswith(prefix) for n in names)}
    return {by_name[name] for name in names} | groups


def _groups(command: Command) -> Iterator[tuple[str, type, str]]:
    """Groups of options: what their options' names begin with, and the class and the field that hold the group."""

    def below(kind: type, prefix: str) -> Iterator[tuple[str, type, str]]:
        for name, hint in get_type_hints(kind, include_extras=True).items():
            if is_dataclass(_bare(hint)):
                own = prefix if _nameless(hint) else f"{prefix}{name}."
                yield own, kind, name
                yield from below(_bare(hint), own)

    for name, hint in get_type_hints(command, include_extras=True).items():
        if is_dataclass(_bare(hint)):
            yield from below(_bare(hint), "" if _nameless(hint) else f"{name}.")


def registry_with(shown: set[tuple[type, str]] | None = None) -> tyro.constructors.ConstructorRegistry:
    """tyro's rules, and one that adds the ranges to the help of options.

    shown: the fields of options that help is to show, in one sentence each; others are hidden. None: all, in full.
    """
    registry = tyro.constructors.ConstructorRegistry()
    busy: set[type] = set()

    @registry.struct_rule
    def rule(info: Any) -> Any:
        kind: type = info.type
        if not is_dataclass(kind) or kind in busy:
            return None
        busy.add(kind)
        try:
            spec = tyro.constructors.ConstructorRegistry.get_struct_spec(info)
        finally:
            busy.discard(kind)
        if not isinstance(spec, tyro.constructors.StructConstructorSpec):
            return spec
        explained = tuple(_explained(kind, field, shown) for field in spec.fields)
        return replace(spec, fields=explained, instantiate=_refusing(spec.instantiate))

    return registry


def _refusing(make: Callable[..., Any]) -> Callable[..., Any]:
    """Makes options; raises _Refused where they are refused."""

    def made(*args: Any, **given: Any) -> Any:
        try:
            return make(*args, **given)
        except InputError as error:
            raise _Refused(error) from error

    return made


def _explained(kind: type, field: Any, shown: set[tuple[type, str]] | None) -> Any:
    """A field with its range in its help; hidden, or in one sentence, where only some are shown."""
    if is_dataclass(_bare(field.type)):
        hidden = shown is not None and not _nameless(field.type) and (kind, field.name) not in shown
        return replace(field, type=Annotated[field.type, tyro.conf.Suppress]) if hidden else field  # type: ignore[valid-type]
    if shown is not None and (kind, field.name) not in shown:
        return replace(field, type=Annotated[field.type, tyro.conf.Suppress])  # type: ignore[valid-type]
    limits, text = described(field.type), field.helptext

    def explanation() -> str:
        words = str((text() if callable(text) else text) or "")
        if shown is not None:
            words = first_clause(words)
        return f"{words} Range: {limits}." if limits else words

    return replace(field, helptext=explanation)


def first_clause(text: str) -> str:
    """The words up to the first full stop or semicolon that is not in brackets, as a sentence."""
    words, depth = " ".join(text.split()), 0
    for n, (character, after) in enumerate(pairwise(words)):
        depth += (character in "([") - (character in ")]")
        if depth == 0 and character in ".;" and after == " ":
            return f"{words[:n]}."
    return words


def _fields_below(kind: type, prefix: str) -> Iterator[tuple[str, type, str]]:
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if name not in {field.name for field in fields(kind)}:
            continue
        if is_dataclass(_bare(hint)):
            yield from _fields_below(_bare(hint), prefix if _nameless(hint) else f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", kind, name


def _bare(hint: Any) -> Any:
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def _nameless(hint: Any) -> bool:
    """Whether tyro leaves the field's own name out of its options' names."""
    return any(getattr(part, "name", None) == "" for part in getattr(hint, "__metadata__", ()))
