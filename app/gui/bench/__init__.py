"""Bench status, notices, prompts and fault injection."""
