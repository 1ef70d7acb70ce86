"""The factor graph: groups of factors, their residuals and rows, and the sums that a solver needs of them."""
