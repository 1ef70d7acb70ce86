"""The exceptions, as one tree. Every message says what was found, where, and what to do.

Classes double as built-ins, so that `except ValueError` works without knowledge of this file.
"""


class PhotoclinometryError(Exception):
    """Root of every error that this package raises on purpose."""


class InputError(PhotoclinometryError, ValueError):
    """The user's input is wrong or contradicts itself (the command ends with exit code 2)."""


class SiteError(InputError):
    """`site.toml` contains something that is not understood or is impossible."""


class ImageError(InputError):
    """An image is missing, unreadable, of the wrong size, or shows nothing."""


class RunFolderError(InputError):
    """A run folder belongs to another version or another site, or cannot be written."""


class OutputError(RunFolderError):
    """Something cannot be written: the disk is full, read-only or broken (the command ends with exit code 1)."""


class ReconstructionError(PhotoclinometryError, RuntimeError):
    """The images do not determine the requested result (the command ends with exit code 1)."""


class FetchError(PhotoclinometryError, OSError):
    """Published data cannot be fetched, or arrived damaged (the command ends with exit code 1)."""


class UntrustedMapError(PhotoclinometryError, RuntimeError):
    """A map was made, and is not to be trusted (the command ends with exit code 3, with all files written)."""
