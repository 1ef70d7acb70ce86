"""Dense matching: where each pixel of the reference region lies in another view."""

from photoclinometry.matching.interface import Matcher, Matches, MatchRequest

__all__ = ["MatchRequest", "Matcher", "Matches"]
