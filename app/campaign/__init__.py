"""Campaigns: plan, item status, queue and summary of a specimen."""
