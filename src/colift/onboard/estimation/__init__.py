"""State estimation and computation of labels from measurements."""
