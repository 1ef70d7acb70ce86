"""Checks of a finished map: each finds one fault, and warns of it or mends it."""
