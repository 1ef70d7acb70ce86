"""Running `phomo` within a test."""

from photoclinometry.cli import main


def phomo(*arguments) -> int:
    """Runs the command; its exit code."""
    try:
        main([str(a) for a in arguments])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0
