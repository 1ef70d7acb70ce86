"""What a finished map is examined for: each finds one fault, and warns of it or mends it."""
