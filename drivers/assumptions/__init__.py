"""What the drivers of sources and cards assume of their instruments, with the evidence for it."""
