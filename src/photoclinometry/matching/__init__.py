"""Dense matching: the position of each pixel of the reference region in another view."""

from photoclinometry.matching.interface import Matcher, Matches, MatchRequest

__all__ = ["MatchRequest", "Matcher", "Matches"]
