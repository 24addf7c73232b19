"""Background computations for a running bench."""
