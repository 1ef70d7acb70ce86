"""PVL: the labels of PDS3 files and ISIS cubes, `KEY = value` in nested objects and groups.

Read in one pass, so that the time grows with the label's length alone. Sources: CCSDS 641.0-B-2; PDS3 Standards
Reference, chapter 12; words that ISIS breaks with a hyphen at the line's end.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from photoclinometry.model.errors import ImageError, InputError

MAX_LABEL_BYTES = 1 << 20
"""1 MiB: labels have at most some 100 kB."""
_MAX_DEPTH = 16
"""Nested objects or lists; labels have about 4, and recursion must end."""
_LONGEST_WORD = 1000
"""A word that begins this near to the end of what was read may continue beyond it [characters]."""
_TOKEN = re.compile(
    r"""(?P<space>[\s\0]+|/\*.*?\*/|\#[^\n]*) | (?P<text>"[^"]*"|'[^']*') | (?P<unit><[^<>\n]*>)
      | (?P<mark>[=(){},]) | (?P<word>[^\s\0=(){},<>"']+)""",
    re.VERBOSE | re.DOTALL,
)
_BEGIN = ("OBJECT", "GROUP", "BEGIN_OBJECT", "BEGIN_GROUP")
_END = ("END_OBJECT", "END_GROUP", "ENDOBJECT", "ENDGROUP")
_INTEGER = re.compile(r"[+-]?\d{1,18}")
_REAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d{1,3})?")


class Quantity(NamedTuple):
    """A number with its unit, as `89.00 <ms>`."""

    value: float
    unit: str
    """In lower case, without brackets."""


class Real(float):
    """A number with its text: spacecraft clocks count ticks after the point, where 1.830 is not 1.83."""

    text: str


@dataclass(frozen=True)
class Block:
    """An object, a group, or the label itself, with its statements in order. Keys are in upper case."""

    name: str
    statements: list[tuple[str, Any]] = field(default_factory=list)
    """(key, value): text, int, float, Quantity, or a tuple of those."""
    blocks: list[Block] = field(default_factory=list)

    def get(self, key: str, default: Any = None) -> Any:
        """The value of the first statement `key` of this block, not of those below."""
        return next((value for name, value in self.statements if name == key), default)

    def block(self, *path: str) -> Block | None:
        """The first block of that path below this one (names in upper case); None if there is none."""
        found: Block | None = self
        for name in path:
            found = next((b for b in found.blocks if b.name == name), None) if found else None
        return found

    def find(self, key: str) -> Any:
        """The first value of `key` in this block or any below; None if there is none."""
        for block in self.walk():
            value = block.get(key)
            if value is not None:
                return value
        return None

    def walk(self) -> Iterator[Block]:
        """This block and all below."""
        yield self
        for block in self.blocks:
            yield from block.walk()


def number(where: object, block: Block, key: str, default: float | None = None) -> float:
    """The value of `key` in a block as a finite number, in the label's unit; where: file. Raises ImageError."""
    value = block.get(key, default)
    value = getattr(value, "value", value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < float("inf"):
        raise ImageError(f"{where}: the label's {key} is {str(value)[:40]!r}, expected a number; correct the label")
    return float(value)


def whole(where: object, block: Block, key: str, default: int | None = None) -> int:
    """As `number`, for counts: whole and not negative. Raises ImageError."""
    value = number(where, block, key, default)
    if value != int(value) or value < 0:
        raise ImageError(f"{where}: the label's {key} is {value:g}, expected a whole number; correct the label")
    return int(value)


def parse_pvl(data: bytes, where: str) -> Block:
    """The label at the beginning of `data`, up to its END; where: file, for messages. Raises InputError."""
    text = data[:MAX_LABEL_BYTES].decode("latin-1")
    stack = [Block("")]
    tokens = _Tokens(text, where, cut=len(data) > MAX_LABEL_BYTES)
    while (key := tokens.take()) is not None:
        key = _keyword(tokens, key)
        if key == "END":
            break
        if key in _END:
            if tokens.peek() == "=":
                tokens.take()
                tokens.take()
            if len(stack) == 1:
                raise tokens.error(f"{key} without a beginning")
            stack.pop()
            continue
        if tokens.take() != "=":
            raise tokens.error(f"after {key[:40]!r} there is no '='")
        value = _value(tokens)
        if key not in _BEGIN:
            stack[-1].statements.append((key, value))
            continue
        if len(stack) > _MAX_DEPTH:
            raise tokens.error(f"objects are nested more than {_MAX_DEPTH} deep")
        stack.append(Block(str(value).upper()))
        stack[-2].blocks.append(stack[-1])
    if len(stack) > 1:
        raise tokens.error(f"{stack[-1].name} is not ended: the label was cut short")
    return stack[0]


class _Tokens:
    """The words of a label, in their order."""

    def __init__(self, text: str, where: str, cut: bool):
        self.text, self.where, self.cut = text, where, cut
        self.at = 0
        self.ahead: list[str | None] = []
        """At most one word, so that nothing after END is parsed."""

    def peek(self) -> str | None:
        if not self.ahead:
            self.ahead.append(self._read())
        return self.ahead[0]

    def take(self) -> str | None:
        return self.ahead.pop() if self.ahead else self._read()

    def error(self, what: str) -> InputError:
        line = self.text.count("\n", 0, self.at) + 1
        return InputError(f"{self.where}: the label is damaged, line {line}: {what}; fetch or export it again")

    def _read(self) -> str | None:
        while (found := _TOKEN.match(self.text, self.at)) is not None:
            self.at = found.end()
            if found.lastgroup != "space":
                return self._joined(found) if found.lastgroup == "word" else found[0]
        if self.cut and self.at > len(self.text) - _LONGEST_WORD:
            raise self.error(f"it has no END in its first {MAX_LABEL_BYTES >> 10} KiB")
        if self.at < len(self.text):
            raise self.error(f"{self.text[self.at : self.at + 20]!r} is not understood")
        return None

    def _joined(self, found: re.Match[str]) -> str:
        """A word that a hyphen at the end of its line continues on the next."""
        parts = [found[0]]
        while parts[-1].endswith("-") and self.text[self.at : self.at + 2].startswith(("\n", "\r\n")):
            rest = re.compile(r"\s*([^\s\0=(){},<>\"']+)").match(self.text, self.at)
            if rest is None:
                break
            parts[-1] = parts[-1][:-1]
            parts.append(rest[1])
            self.at = rest.end()
        word = "".join(parts)
        if not word.isascii():
            raise self.error(f"{word[:20]!r} is not ASCII text")
        return word


def _keyword(tokens: _Tokens, key: str) -> str:
    if key[0] in "\"'<=(){},":
        raise tokens.error(f"expected a keyword, found {key[:20]!r}")
    return key.upper()


def _value(tokens: _Tokens, depth: int = 0) -> Any:
    token = tokens.take()
    if token is None or token in "=),}":
        raise tokens.error(f"expected a value, found {token!r}")
    if token in "({":
        if depth > _MAX_DEPTH:
            raise tokens.error(f"lists are nested more than {_MAX_DEPTH} deep")
        value: Any = _sequence(tokens, depth)
    elif token[0] in "\"'":
        value = re.sub(r"-?\s*\n\s*", lambda m: "" if m[0].startswith("-") else " ", token[1:-1]).strip()
    else:
        value = _plain(token)
    following = tokens.peek()
    if following is not None and following.startswith("<"):
        tokens.take()
        unit = following[1:-1].strip().lower()
        return Quantity(float(value), unit) if isinstance(value, int | float) else value
    return value


def _sequence(tokens: _Tokens, depth: int) -> tuple[Any, ...]:
    values = []
    while tokens.peek() not in (")", "}", None):
        if tokens.peek() == ",":
            tokens.take()
        else:
            values.append(_value(tokens, depth + 1))
    if tokens.take() is None:
        raise tokens.error("a list is not closed")
    return tuple(values)


def _plain(word: str) -> Any:
    if _INTEGER.fullmatch(word):
        return int(word)
    if _REAL.fullmatch(word):
        real = Real(word.upper().replace("D", "E"))
        real.text = word
        return real
    return word
