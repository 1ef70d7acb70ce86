"""Pose priors drawn about true poses, and the small site with them."""

from dataclasses import replace

from photoclinometry.io.site import read_site
from photoclinometry.model.geometry import Rigid, so3_exp
from photoclinometry.model.pose_prior import PosePrior


def priors_of(names, poses, rotation_sigma, center_sigma, rng, noise=1.0):
    """Priors of true poses (K,), off by `noise` times the sigmas that they state."""
    rotation = poses.rotation @ so3_exp(noise * rotation_sigma * rng.normal(size=(len(names), 3)))
    center = poses.translation + noise * center_sigma * rng.normal(size=(len(names), 3))
    known = Rigid(rotation, center).inverse()
    return {name: PosePrior(known[k], rotation_sigma, center_sigma) for k, name in enumerate(names)}


def with_priors(mapped, priors, folder):
    """The small site with priors, in a folder of its own."""
    views = tuple(replace(view, pose_prior=priors.get(view.name)) for view in read_site(mapped.site).views)
    return mapped.changed_site(folder, views=views)
