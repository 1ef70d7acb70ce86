"""Bringing maps into other frames: those of other maps, or of pose priors."""
