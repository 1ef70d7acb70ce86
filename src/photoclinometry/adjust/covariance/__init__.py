"""Marginal covariances at the minimum."""
