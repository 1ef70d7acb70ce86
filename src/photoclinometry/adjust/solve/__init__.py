"""The minimum of a factor graph, by Levenberg-Marquardt with conjugate gradients."""
