"""`phomo fetch`: published images and models."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from photoclinometry.cli.bars import progress_bars
from photoclinometry.io.hub import AUTHORS_DATA


def fetch(
    name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")] = None,
    /,
    out: Path = Path("phomo-data"),
    dataset: str = AUTHORS_DATA,
    revision: str = "main",
    endpoint: str | None = None,
) -> None:
    """Fetch published sites, such as those of the paper's authors, from Hugging Face.

    Without a name, lists the folders of the data set. If it is interrupted, the same command resumes; files that exist
    already are verified and kept.

    Args:
        name: Folder of the data set, by its path, or by its name wherever it occurs (images and models of a site).
        out: Folder for the data set's folders.
        dataset: OWNER/NAME of a public data set.
        revision: Branch, tag or commit.
        endpoint: Address of another server of the same kind. Default: $HF_ENDPOINT, or huggingface.co.
    """
    from rich.console import Console

    from photoclinometry.io.hub import fetch_files, list_files

    data = list_files(dataset, revision=revision, endpoint=endpoint)
    if name is None:
        for folder, (count, size) in data.folders().items():
            print(f"{folder}  {count} files, {size / 1e6:.1f} MB")
        return
    files = data.named(name)
    console = Console(stderr=True, soft_wrap=True)
    with progress_bars(console) as progress:
        fetched = fetch_files(data, files, out, progress)
    total = sum(file.size for file in files) / 1e6
    console.print(
        f"{len(files)} files, {total:.1f} MB, verified; {len(fetched)} fetched now, from {dataset} at {data.commit}",
        highlight=False,
        markup=False,
    )
    print(out)
