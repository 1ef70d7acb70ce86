"""RoMa (v1) by the package `romatch`, with weights from local files. Needs the extra `roma` (torch).

Edstedt, Sun, Bökman, Wadenbäck and Felsberg (2024), RoMa: Robust Dense Feature Matching, CVPR, arXiv:2305.15404; what
the paper of Driver et al. matches with. Its frozen backbone is DINOv2 (Oquab et al. 2023). Nothing is downloaded here.

Its accuracy on images of small bodies is not known here. With the published weights, on pictures of 560 px of
MegaDepth, 85.2 % of the matches are within 1 px and 95.7 within 3 (the authors' tests/test_mega_dense.py). For those
within 3, that is a standard deviation of 1 / sqrt(-2 ln(1 - 0.852 / 0.957)) = 0.48 px about each axis, errors of that
truth included: hence `sigma_cells`. The certainty is trained to say whether a pixel is seen in both pictures and the
coarser scales were within 4 px of 512. It selects the matches to keep, and does not measure their precision.
"""

from __future__ import annotations

import importlib.util
import pickle
import warnings
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from photoclinometry.io.reading import read_bytes
from photoclinometry.matching.warp import Warp, WarpMatcher, WarpOptions
from photoclinometry.model.errors import InputError
from photoclinometry.model.ranges import Range

PUBLISHED = {
    "weights": "https://github.com/Parskatt/storage/releases/download/roma/roma_outdoor.pth",
    "dinov2": "https://dl.fbaipublicfiles.com/dinov2/dinov2_vitl14/dinov2_vitl14_pretrain.pth",
}
"""Where the authors publish what each option wants: 446 MB and 1.2 GB."""

HOLDS = {"weights": "decoder.embedding_decoder.to_out.weight", "dinov2": "patch_embed.proj.weight"}
"""A parameter by which each file is known."""

IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


@dataclass(frozen=True, kw_only=True)
class RomaOptions(WarpOptions):
    """Dense matching by RoMa, for `--matcher roma`."""

    weights: Path | None = None
    """File of RoMa's own weights: roma_outdoor.pth, as its authors publish it. Nothing is downloaded."""
    dinov2: Path | None = None
    """File of the backbone's weights: dinov2_vitl14_pretrain.pth, as published for DINOv2."""
    coarse_px: Annotated[int, Range(least=56, most=8192, multiple_of=14)] = 560
    """Side of the picture in which it is matched first; a multiple of 14. It was trained with 560."""
    fine_px: Annotated[int, Range(least=32, most=8192, multiple_of=8)] = 864
    """Side of the picture in which that is refined; a multiple of 8."""
    device: str = "cpu"
    """Where the network runs, in torch's words: cpu, cuda."""


def roma_matcher(options: RomaOptions) -> WarpMatcher:
    """RoMa as a matcher; weights are read when it matches for the first time. Raises InputError for what is missing."""
    for name, url in PUBLISHED.items():
        path = getattr(options, name)
        if path is None:
            raise InputError(f"the matcher roma needs --roma.{name} FILE; nothing is downloaded, fetch it from {url}")
        read_bytes(path, f"file of weights for --roma.{name} (published at {url})", limit=1)
    for package in ("torch", "romatch"):
        if importlib.util.find_spec(package) is None:
            raise InputError(f"the matcher roma needs the package {package}: pip install 'photoclinometry[roma]'")
    return WarpMatcher(RomaNetwork(options), options, "roma")


def fingerprint(options: RomaOptions) -> dict[str, Any]:
    """The options with the weights' contents (SHA-256) for their paths: what matches depend on."""
    import hashlib

    found = asdict(options)
    for name in PUBLISHED:
        with open(getattr(options, name), "rb") as stream:
            found[name] = hashlib.file_digest(stream, "sha256").hexdigest()
    return found


@dataclass(frozen=True)
class RomaNetwork:
    """The network, loaded when first called (`warp.Network`)."""

    options: RomaOptions

    def __call__(self, a: np.ndarray, b: np.ndarray) -> tuple[Warp, Warp]:
        coarse, fine = self.options.coarse_px, self.options.fine_px
        low, high = ([self._input(picture, side) for picture in (a, b)] for side in (coarse, fine))
        warp, certainty = self.model.match(*low, im_A_high_res=high[0], im_B_high_res=high[1])
        warp, certainty = warp[0].cpu().numpy(), certainty[0].cpu().numpy()
        return (
            Warp(position=warp[:, :fine, 2:], certainty=certainty[:, :fine]),
            Warp(position=warp[:, fine:, :2], certainty=certainty[:, fine:]),
        )

    @cached_property
    def model(self) -> Any:
        """romatch's model, both ways at once. Raises InputError for weights that are not its."""
        import torch  # pyright: ignore[reportMissingImports]
        from loguru import logger  # pyright: ignore[reportMissingImports]
        from romatch.models.model_zoo import roma_model  # pyright: ignore[reportMissingImports]

        options = self.options
        logger.disable("romatch")
        try:
            torch.empty(1, device=options.device)
        except (RuntimeError, AssertionError) as error:  # AssertionError: a build of torch without CUDA
            raise InputError(f"--roma.device {options.device}: torch cannot use it ({_first_line(error)})") from error
        weights, dinov2 = _state(options, "weights"), _state(options, "dinov2")
        try:
            with warnings.catch_warnings():  # it sets filters of its own
                return roma_model(
                    resolution=options.coarse_px,
                    upsample_preds=True,
                    upsample_res=options.fine_px,
                    device=options.device,
                    symmetric=True,
                    use_custom_corr=False,
                    weights=weights,
                    dinov2_weights=dinov2,
                )
        except RuntimeError as error:
            raise InputError(
                f"{options.weights}, {options.dinov2}: are not weights of RoMa (v1, outdoor or indoor) and of DINOv2's "
                f"ViT-L/14: {_first_line(error)}; fetch {' and '.join(PUBLISHED.values())}"
            ) from error

    def _input(self, picture: np.ndarray, side: int) -> Any:
        """(1, 3, side, side) on the device, normalised as the backbone was trained."""
        import torch  # pyright: ignore[reportMissingImports]
        from torch.nn.functional import interpolate  # pyright: ignore[reportMissingImports]

        whole = torch.from_numpy(np.ascontiguousarray(picture, np.float32))[None, None].to(self.options.device)
        sized = interpolate(whole, size=(side, side), mode="bicubic", antialias=True, align_corners=False).clamp(0, 1)
        mean, std = (torch.tensor(v, device=whole.device).view(1, 3, 1, 1) for v in (IMAGENET_MEAN, IMAGENET_STD))
        return (sized - mean) / std


def _state(options: RomaOptions, name: str) -> dict[str, Any]:
    """The parameters that a file of weights holds, by their names."""
    import torch  # pyright: ignore[reportMissingImports]

    path = getattr(options, name)
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, ValueError, KeyError, EOFError, pickle.UnpicklingError) as error:
        raise InputError(
            f"{path}: cannot be read as weights ({_first_line(error)}); fetch {PUBLISHED[name]} again"
        ) from error
    if not isinstance(state, dict) or HOLDS[name] not in state:
        raise InputError(f"{path}: holds no weights for --roma.{name}; fetch {PUBLISHED[name]}")
    return state


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
