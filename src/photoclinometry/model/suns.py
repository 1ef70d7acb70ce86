"""Definition of a site's Sun direction, in the words of errors about Suns that contradict the images."""

SUN_CONVENTION = "`sun` points from the body towards the Sun, in the camera frame (x right, y down, z forward)"
