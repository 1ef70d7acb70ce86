import numpy as np
import pytest


@pytest.fixture(scope="session")
def mapped(tmp_path_factory):
    """A small simulated site and the run that mapped it (`runs.Mapped`); for reading only."""
    from runs import map_small_site

    return map_small_site(tmp_path_factory.mktemp("mapped"))


@pytest.fixture
def adjust_nothing(monkeypatch):
    """The joint estimate stops at once, for tests of what surrounds it; the options of each call."""
    from photoclinometry.adjust import Adjustment, Noise
    from photoclinometry.pipeline import joint_estimate

    calls = []

    def stand_in(scene, options, pose_priors=None, **_):
        calls.append(options)
        used = np.zeros(0, bool) if pose_priors is None else np.isfinite(pose_priors.center_sigma)
        noise = Noise(
            keypoint_factor=1.0,
            keypoint_correlation_px=1.0,
            pose_only_keypoint_factor=1.0,
            sparse_keypoint_factor=1.0,
            brightness_sigma=0.001,
            brightness_correlation_px=1.0,
        )
        return Adjustment(scene, True, "not adjusted", (), noise, scene.tracks.lit, pose_priors_used=used)

    monkeypatch.setattr(joint_estimate, "adjust", stand_in)
    return calls


@pytest.fixture
def no_figures(monkeypatch, mapped):
    """Figures are drawn once, for the shared run; `test_report.py` proves them."""
    monkeypatch.setattr("photoclinometry.output.report.write_report", lambda folder, *_, **__: folder / "index.html")
