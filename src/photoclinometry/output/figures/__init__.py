"""Pictures of maps: layers, scale bars and arrows, profiles, residuals, and figures for publication.

The report, `pcm.plot` and `phomo figure` draw with these functions.
"""
