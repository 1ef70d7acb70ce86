"""The body-fixed frame of a map: by pose priors, by control points, by laser altimetry."""
