"""Radiance fields: density and brightness of every place in a box, and pictures by integrating along rays."""
