"""Everything that shapes a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from photoclinometry.adjust import AdjustOptions
from photoclinometry.matching.densify import DensifyOptions
from photoclinometry.matching.flow import FlowOptions
from photoclinometry.matching.registry import MATCHERS, matcher_entry
from photoclinometry.matching.roma import RomaOptions
from photoclinometry.model.errors import InputError
from photoclinometry.model.ranges import Range, Ranged
from photoclinometry.model.reflectance import ModelChoice
from photoclinometry.sfm import SfmOptions
from photoclinometry.sfm.region import RegionOptions


@dataclass(frozen=True, kw_only=True)
class RelightOptions(Ranged):
    """Relighting iterations: views are matched with the reference as it would look under each view's Sun."""

    iterations: Annotated[int, Range(least=0, most=100)] = 3
    """Relighting iterations at most, after the first map. Geometry alone has none."""
    settled_px: Annotated[float, Range(least=0)] = 0.03
    """No further iteration once half of all matches moved by less [px]; from the second on, as the first is loose."""
    keypoint_sigma_factor: Annotated[float, Range(above=0)] = 5.0
    """Factor on the standard deviations of keypoints in all iterations but the last. Below the window size, matches to
    a relit image are biased towards the map that was used for relighting: held tightly, that map hardly moves."""
    direct: bool = True
    """Direct photometric refinement: the last estimate takes each image's brightness and gradient where the map
    projects, instead of the matches."""
    psf_sigma_px: Annotated[float | None, Range(least=0, most=64)] = None
    """Standard deviation of the camera's point-spread function [px]. The finest relief, which it and the pixels average
    away, is restored, unless `direct` is off. By default it is determined from the images: at most 1, and 0.5 unless
    they are clearly sharper or more blurred."""


@dataclass(frozen=True, kw_only=True)
class RunOptions(Ranged):
    """Everything that shapes a run. Every field has a default that suits most sites."""

    reflectance: ModelChoice = "auto"
    """Reflectance model. auto: lunar-lambert where the body has published coefficients, else mcewen; before the last
    estimate, the one that best predicts views kept out. none: geometry alone (dense structure from motion)."""
    matching_passes: Annotated[int, Range(least=1, most=100)] = 2
    """Matching passes before the first map: after a pre-warp by the sparse surface, then by the dense one."""
    matcher: str = "relight"
    """relight: optical flow, then relighting iterations, which match each view with the reference relit for it. flow:
    optical flow on the images themselves, and no iterations. roma: as relight, but the first map's matches are RoMa's
    (--roma.weights, --roma.dinov2). Or another name in `matching.registry`, followed by iterations with that matcher.
    --relight.iterations 0 leaves the map at the first matches."""
    hold_out: tuple[str, ...] = ()
    """Views that are left out of the map and used to measure it: only their poses are found, from the finished map."""
    pose_priors: bool = True
    """Where three views or more have pose priors (`cam_from_body`), put the map into their frame, body-fixed and in
    metres, and use them in the estimate."""
    control: Path | None = None
    """Table of ground control points (CSV): point,view,x_px,y_px,x_m,y_m,z_m,sigma_m. Three or more put the map into
    their frame where there are no pose priors; all of them take part in the estimate."""
    altimetry: Path | None = None
    """Table of laser altimetry (CSV): track,x_m,y_m,z_m,sigma_m,track_sigma_m, body-fixed. Shots over the map take part
    in the estimate, once pose priors or control points have put it roughly in place."""
    check_views: bool = True
    """Leave out views whose Sun direction or content contradicts the brightness of the others, and views that are less
    sharp than the first map."""
    sfm: SfmOptions = field(default_factory=SfmOptions)
    region: RegionOptions = field(default_factory=RegionOptions)
    flow: FlowOptions = field(default_factory=FlowOptions)
    roma: RomaOptions = field(default_factory=RomaOptions)
    relight: RelightOptions = field(default_factory=RelightOptions)
    densify: DensifyOptions = field(default_factory=DensifyOptions)
    adjust: AdjustOptions = field(default_factory=AdjustOptions)

    def __post_init__(self):
        super().__post_init__()
        known = ("relight", *MATCHERS)
        if self.matcher not in known:
            raise InputError(f"no matcher {self.matcher!r}; known: {', '.join(known)}")

    @property
    def matcher_name(self) -> str:
        """The matcher of the first map, as `matching.registry` names it."""
        return "flow" if self.matcher == "relight" else self.matcher

    @property
    def max_iterations(self) -> int:
        """Relighting iterations at most."""
        return 0 if self.matcher == "flow" else self.relight.iterations

    def of_matcher(self, name: str) -> Any:
        """The options of a matcher: the field of its name where it has one, else those in its entry."""
        default = matcher_entry(name).options
        own = getattr(self, name, None)
        return own if isinstance(own, type(default)) else default
