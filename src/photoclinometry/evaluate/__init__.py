"""Figures of a map: against its images, the truth of a simulation, or another map."""
