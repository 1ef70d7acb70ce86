"""The command `phomo`. A command parses, calls one library function, and prints the path of its result.

Exit codes:

- 0: success.
- 1: the images do not determine a result, data cannot be fetched, output cannot be written (disk full, no
  permission), or memory does not suffice.
- 2: misuse: a mistake in what was given, or a folder that belongs to another site or is in use.
- 3: a map was made and all its files are written, but it is not to be trusted; the last line says why.
- 130: interrupted (Ctrl-C). 143: terminated (SIGTERM). 129: the terminal or SSH session was closed (SIGHUP; `nohup`
  keeps a command). The same command goes on from what is finished.
- 141: the reader of the output has closed it (`phomo ... | head`).
"""

from __future__ import annotations

import errno
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import NoReturn

DISK = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO})
"""Errors of a file system, which are no mistakes of the program."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: parses, runs, and turns the package's errors into one line and an exit code."""
    from photoclinometry.cli.signals import SAYS, TerminatedError, stoppable

    try:
        try:
            with stoppable():
                _run(arguments)
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        _fail(*SAYS[signal.SIGINT])
    except TerminatedError as ended:
        _fail(*SAYS[ended.number])
    except BrokenPipeError:
        _forget_output()
        raise SystemExit(141) from None
    except MemoryError as error:
        reason = f" ({error})" if str(error) else ""
        _fail(f"out of memory{reason}; give a smaller region, a larger stride, or fewer or smaller images", 1)
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            from photoclinometry.io.atomic import too_long

            _fail(f"{too_long(error.filename)}: {error.strerror}; choose a shorter path", 2)
        if error.errno not in DISK:
            raise
        if error.filename is None:
            _forget_output()
        _fail(f"{error.filename or 'the output'}: {error.strerror}; free some space, or choose another place", 1)


def _forget_output() -> None:
    """Python would report an error when it flushes the rest of the output at exit."""
    with suppress(OSError), open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), sys.stdout.fileno())


def _run(arguments: Sequence[str] | None) -> None:
    # Waiting threads should sleep instead of spinning, since compiled loops are short.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    # Matrices have a few hundred rows: threads of linear algebra would wait for one another more than they compute.
    for library in ("OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    from photoclinometry.cli.arguments import call
    from photoclinometry.model.errors import InputError, OutputError, PhotoclinometryError, UntrustedMapError

    try:
        call(arguments)
    except UntrustedMapError as error:
        _fail(error, 3)
    except OutputError as error:
        _fail(error, 1)
    except InputError as error:
        _fail(error, 2)
    except PhotoclinometryError as error:
        _fail(error, 1)


def _fail(reason: object, code: int) -> NoReturn:
    print(f"phomo: {reason}", file=sys.stderr)
    raise SystemExit(code)
