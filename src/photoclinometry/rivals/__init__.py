"""Other published methods on the images, poses and views of a finished run."""
