"""The command `phomo`. A command parses, calls one library function, and prints the path of its result.

Exit codes: 0 success; 1 the images do not determine a result, or data cannot be fetched; 2 misuse; 130 interrupted; 141
the reader of the output has closed it (`phomo ... | head`).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: parses, runs, and turns the package's errors into one line and an exit code."""
    try:
        try:
            _run(arguments)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # Python would report an error when it flushes the rest of the output at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(141) from None


def _run(arguments: Sequence[str] | None) -> None:
    # Waiting threads should sleep instead of spinning, since compiled loops are short.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from photoclinometry.cli.arguments import call
    from photoclinometry.model.errors import InputError, PhotoclinometryError

    try:
        call(arguments)
    except InputError as error:
        _fail(error, 2)
    except PhotoclinometryError as error:
        _fail(error, 1)
    except KeyboardInterrupt:
        _fail("interrupted; the same command resumes after the last finished stage", 130)


def _fail(reason: object, code: int) -> None:
    print(f"phomo: {reason}", file=sys.stderr)
    raise SystemExit(code)
