"""The page of a specimen: its sheet."""
