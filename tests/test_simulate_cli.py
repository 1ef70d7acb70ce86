import pytest
import tyro

from photoclinometry.cli.simulate import Simulate, simulate
from photoclinometry.io.site import read_site
from photoclinometry.model.errors import InputError


def parse(*arguments):
    return tyro.cli(Simulate, args=[str(a) for a in arguments])


def test_the_command_writes_a_site_and_says_where(tmp_path, capsys):
    arguments = parse("--out", tmp_path / "s", "--views", 3, "--image-size", 48, "--lighting", "strong", "--seed", 2)
    assert (arguments.options.lighting, arguments.options.seed) == ("strong", 2)
    path = simulate(arguments)
    assert len(read_site(path).views) == 3
    assert str(path) in capsys.readouterr().err
    with pytest.raises(InputError, match="--overwrite"):
        simulate(arguments)


def test_the_detector_can_be_set():
    arguments = parse("--out", "s", "--detector.no-noise", "--detector.psf-sigma-px", "0.8")
    assert not arguments.options.detector.noise
    assert arguments.options.detector.psf_sigma_px == 0.8
