"""`phomo ingest`: what it prints, and its exit codes."""

import numpy as np
import pytest

from archives import texture
from photoclinometry.cli import main
from photoclinometry.io.images import write_png
from photoclinometry.io.site import read_site


@pytest.fixture
def images(tmp_path):
    paths = [tmp_path / f"{k}.png" for k in range(3)]
    for k, path in enumerate(paths):
        write_png(path, (texture(seed=k) * 1e6).astype(np.uint16))
    (tmp_path / "suns.csv").write_text("image,sun_x,sun_y,sun_z\n" + "".join(f"{k}.png,0.6,0,-0.8\n" for k in range(3)))
    return [str(p) for p in paths]


def test_a_site_is_made_and_said(tmp_path, images, capsys):
    arguments = ["--suns", str(tmp_path / "suns.csv"), "--pinhole", "500", "500", "30", "20", "--body", "bennu"]
    main(["ingest", *images, "--out", str(tmp_path / "site"), *arguments])
    printed = capsys.readouterr()
    assert printed.out.strip() == str(tmp_path / "site" / "site.toml")
    assert "table of Suns" in " ".join(printed.err.split())
    assert len(read_site(tmp_path / "site" / "site.toml").views) == 3
