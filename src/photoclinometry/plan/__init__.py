"""Uncertainties of a map before its images are taken: a representative map of a place, and the gain by one more
image."""
