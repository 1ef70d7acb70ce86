"""Images of archives: PDS3, PDS4, ISIS cubes, FITS."""
