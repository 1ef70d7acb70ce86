"""A map against its own images, the truth or another map."""
