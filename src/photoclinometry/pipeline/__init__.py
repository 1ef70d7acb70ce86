"""The stages of a run in order, and what keeps them on disk."""
