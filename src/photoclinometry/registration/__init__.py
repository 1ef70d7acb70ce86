"""One frame to another: maps to maps, maps to pose priors."""
