"""Models of other programs: COLMAP, the paper's authors, SUMFILEs."""
