"""Plots of points, curves, traces and residuals."""
