"""RoMa: what is refused without torch, and, where torch is installed, the real network with random weights, offline."""

import socket
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from displaced_images import displaced
from photoclinometry.matching.flow import FlowMatcher
from photoclinometry.matching.registry import MATCHERS
from photoclinometry.matching.roma import PUBLISHED, RomaNetwork, RomaOptions, fingerprint, roma_matcher
from photoclinometry.matching.warp import pixel_centers
from photoclinometry.model.errors import InputError
from photoclinometry.pipeline.options import RelightOptions
from photoclinometry.pipeline.run import RunOptions, run

PACKAGES = ("torch", "romatch")


@pytest.fixture
def files(tmp_path):
    """Options with two files, which are no weights."""
    (tmp_path / "roma.pth").write_bytes(b"roma")
    (tmp_path / "dinov2.pth").write_bytes(b"dinov2")
    return RomaOptions(weights=tmp_path / "roma.pth", dinov2=tmp_path / "dinov2.pth")


def spare_packages(monkeypatch):
    """As if the extra were installed."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)


@pytest.mark.parametrize("name", list(PUBLISHED))
def test_weights_not_given_or_not_there_are_named_with_where_they_are_published(files, name):
    for options in (replace(files, **{name: None}), replace(files, **{name: Path("elsewhere.pth")})):
        with pytest.raises(InputError, match=rf"--roma\.{name}\b.*{PUBLISHED[name]}"):
            roma_matcher(options)
    with pytest.raises(InputError, match=r"elsewhere\.pth: there is no such file"):
        roma_matcher(replace(files, **{name: Path("elsewhere.pth")}))


@pytest.mark.parametrize("package", PACKAGES)
def test_a_missing_package_names_the_extra(monkeypatch, files, package):
    spare_packages(monkeypatch)
    assert roma_matcher(files).name == "roma"
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == package else name)
    with pytest.raises(InputError, match=rf"{package}: pip install 'photoclinometry\[roma\]'"):
        roma_matcher(files)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"coarse_px": 561}, "coarse_px is 561; give a whole number, 56 to 8192, a multiple of 14"),
        ({"coarse_px": 0}, "coarse_px is 0"),
        ({"fine_px": 860}, "fine_px is 860; give a whole number, 32 to 8192, a multiple of 8"),
        ({"fine_px": -8}, "fine_px is -8"),
    ],
)
def test_sides_that_the_network_cannot_take_are_refused(files, change, message):
    with pytest.raises(InputError, match=message):
        roma_matcher(replace(files, **change))


def test_contents_of_weights_count_and_their_paths_do_not(files, tmp_path):
    moved = tmp_path / "moved.pth"
    moved.write_bytes(files.weights.read_bytes())
    assert fingerprint(replace(files, weights=moved)) == fingerprint(files)
    assert fingerprint(replace(files, sigma_cells=1.0)) != fingerprint(files)
    before = fingerprint(files)
    files.weights.write_bytes(b"others")
    assert fingerprint(files) != before


def test_torch_is_not_imported_until_it_matches():
    code = f"""
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {PACKAGES}:
            raise AssertionError(name)
sys.meta_path.insert(0, Refuse())
import photoclinometry.cli, photoclinometry.pipeline, photoclinometry.matching.roma
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_first_map_is_made_of_its_matches_anew_only_for_other_weights(
    monkeypatch, mapped, tmp_path, files, adjust_nothing, no_figures, photometry_as_stated
):
    """The network is stood in for by flow, whose calls are counted; the run of six views goes on in a mapped folder."""
    calls = []

    class Counted(FlowMatcher):
        def match(self, request):
            calls.append(request.target.name)
            return super().match(request)

    monkeypatch.setitem(MATCHERS, "roma", replace(MATCHERS["roma"], make=lambda options: Counted()))
    folder = mapped.copy(tmp_path / "run")
    options = RunOptions(matcher="roma", roma=files, relight=RelightOptions(iterations=0), matching_passes=1)
    result = run(mapped.site, folder, options)
    views = result.scene.views
    assert sorted(calls) == sorted(set(views.name) - {views.name[result.scene.reference]})
    config = tomllib.loads((folder / "config.toml").read_text())
    assert config["roma"]["weights"] == str(files.weights)
    run(mapped.site, folder, options)
    assert len(calls) == 5
    files.weights.write_bytes(b"others")
    run(mapped.site, folder, options)
    assert len(calls) == 10


# The network itself, with random weights.


@pytest.fixture(scope="module")
def random_weights(tmp_path_factory):
    """Files of random weights of RoMa, and of its backbone cut to one layer of 24."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'photoclinometry[roma]'")
    pytest.importorskip("romatch", reason="romatch is not installed: pip install 'photoclinometry[roma]'")
    from romatch.models import transformer
    from romatch.models.model_zoo import roma_model

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(socket.socket, "connect", _no_network)
        patch.setattr(transformer, "vit_large", _one_layer)
        folder = tmp_path_factory.mktemp("weights")
        options = RomaOptions(weights=folder / "roma.pth", dinov2=folder / "dinov2.pth", coarse_px=112, fine_px=112)
        torch.manual_seed(0)
        backbone = transformer.vit_large(img_size=518, patch_size=14, init_values=1.0, ffn_layer="mlp", block_chunks=0)
        torch.save(backbone.state_dict(), options.dinov2)
        with patch.context() as untrained:
            untrained.setattr(torch.nn.Module, "load_state_dict", lambda *_, **__: None)
            model = roma_model(112, True, device="cpu", weights={}, dinov2_weights={}, upsample_res=112)
        torch.save(model.state_dict(), options.weights)
        yield options
    options.weights.unlink()  # half a gigabyte
    options.dinov2.unlink()


def _no_network(*_):
    raise AssertionError("the network was called")


def _one_layer(**options):
    from functools import partial

    from romatch.models.transformer import dinov2
    from romatch.models.transformer.layers import MemEffAttention

    block = partial(dinov2.Block, attn_class=MemEffAttention)
    return dinov2.DinoVisionTransformer(embed_dim=1024, depth=1, num_heads=16, mlp_ratio=4, block_fn=block, **options)


def test_warps_are_those_of_romatchs_own_match_of_8_bit_pictures(random_weights):
    from PIL import Image

    network = RomaNetwork(random_weights)
    a, b = np.random.default_rng(0).integers(0, 256, (2, 112, 112), np.uint8)
    there, back = network((a / 255.0).astype(np.float32), (b / 255.0).astype(np.float32))
    warp, certainty = network.model.match(*(Image.fromarray(p).convert("RGB") for p in (a, b)))
    expected, certain = warp[0].numpy(), certainty[0].numpy()
    np.testing.assert_allclose(expected[:, :112, :2], 2.0 * pixel_centers((112, 112)) / 112 - 1.0, atol=1e-6)
    np.testing.assert_allclose(there.position, expected[:, :112, 2:], atol=1e-4)
    np.testing.assert_allclose(back.position, expected[:, 112:, :2], atol=1e-4)
    np.testing.assert_allclose(there.certainty, certain[:, :112], atol=1e-4)
    np.testing.assert_allclose(back.certainty, certain[:, 112:], atol=1e-4)
    assert np.ptp(there.position) > 0.01


def test_a_network_made_to_say_one_place_matches_that_place_alone(random_weights):
    """All weight on one of 64 x 64 anchors, and no refinement: every pixel is said to lie at that anchor's centre."""
    import torch

    matcher = roma_matcher(random_weights)
    decoder = matcher.network.model.decoder
    row, col = 20, 40
    with torch.no_grad():
        last = [refiner.out_conv for refiner in decoder.conv_refiner.values()] + [decoder.embedding_decoder.to_out]
        for layer in last:
            layer.weight.zero_()
            layer.bias.zero_()
        last[-1].bias[64 * row + col] = 100.0
        last[-1].bias[-1] = np.log(3.0)  # a certainty of 3/4
    request, _ = displaced()
    matches = matcher.match(request)
    size = np.array([request.padded.width, request.padded.height])
    anchor = (np.array([col, row]) + 0.5) / 64 * size
    here = request.padded.pixel_centers()[request.inner]
    distance = np.linalg.norm(here - (request.padded.col, request.padded.row) - anchor, axis=-1)
    np.testing.assert_array_equal(matches.valid, distance < 1.0)
    assert matches.valid.sum() in (3, 4)
    true = anchor + (request.padded.col, request.padded.row) + 20.0
    np.testing.assert_allclose(matches.position[matches.valid], np.tile(true, (matches.valid.sum(), 1)), atol=1e-3)
    np.testing.assert_allclose(matches.certainty[matches.valid], 0.75, atol=1e-5)
    expected = np.hypot(0.5 * np.sqrt(np.prod(size)) / 112, distance)
    np.testing.assert_allclose(matches.sigma_px[matches.valid], expected[matches.valid], atol=1e-3)


def test_files_that_are_not_its_weights_are_refused_by_name(random_weights, tmp_path):
    import torch

    def refused(message, **files):
        with pytest.raises(InputError, match=message):
            _ = RomaNetwork(replace(random_weights, **files)).model

    broken = tmp_path / "broken.pth"
    for content in (b"", b"no weights", random_weights.dinov2.read_bytes()[:100_000]):
        broken.write_bytes(content)
        refused("broken.pth: cannot be read as weights", weights=broken)
    torch.save(Path("an object, which could do anything when read"), broken)
    refused("broken.pth: cannot be read as weights", weights=broken)
    torch.save(torch.zeros(3), broken)
    refused("broken.pth: holds no weights for --roma.dinov2", dinov2=broken)
    swapped = {"weights": random_weights.dinov2, "dinov2": random_weights.weights}
    refused("dinov2.pth: holds no weights for --roma.weights", **swapped)
    torch.save({"patch_embed.proj.weight": torch.zeros(3)}, broken)
    refused(r"roma.pth, .*broken.pth: are not weights of RoMa", dinov2=broken)


@pytest.mark.parametrize("device", ["cuda", "abacus"])
def test_a_device_that_is_not_there_is_refused(random_weights, device):
    import torch

    if device == "cuda" and torch.cuda.is_available():
        pytest.skip("there is a CUDA device here")
    with pytest.raises(InputError, match=f"--roma.device {device}: torch cannot use it"):
        _ = RomaNetwork(replace(random_weights, device=device)).model
