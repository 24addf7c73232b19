"""Bench files: tables, validation, driver registry, device discovery."""
