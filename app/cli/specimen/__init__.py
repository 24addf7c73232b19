"""Commands on specimen sheets."""
