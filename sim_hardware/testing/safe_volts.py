"""Safe-voltage assertion on the volts of the simulated source."""

from sim_hardware.plant import VoltageReport

STEP_V = 0.05
"""Largest step of the default drive limits; on the plant's grid only rounding may exceed it."""


def assert_safe_voltage(report: VoltageReport) -> None:
    """Raise AssertionError unless the history kept to the amplifier's range, without jumps, switched and ended at rest."""
    assert report.lowest_v >= -1e-9, report
    assert report.highest_v <= 5 + 1e-9, report
    assert report.largest_jump_v <= STEP_V + 1e-6, report
    assert report.steepest_v_per_s <= 10_000, report
    assert report.switched_at_rest, report
    assert report.ends_at_rest or report.live_s == 0, report  # not required of a bench that was never live
