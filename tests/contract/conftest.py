"""Contract tests of which the quick tier runs a part: every device and every case once, not all their pairs."""

import pytest

ONE_IN = {
    "test_failed_link_raises_link_error_and_reconnects": 6,
    "test_sweep_and_steps_follow_the_drive_and_end_at_rest": 5,
}
"""One more than a device has cases, so that the cases are dealt to the devices in turn."""

VARIANTS_IN = 37
"""One in so many cases of the variants is quick; it divides no number of variants, so that all cases and models have their turn."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests, which come from `sim_hardware.testing`, where there are no tiers."""
    variants = [item for item in items if item.path.name == "test_sources_variants.py" and "[" in item.name]
    for place, item in enumerate(variants):
        if place % VARIANTS_IN:
            item.add_marker("deep")
    for item in items:
        n = ONE_IN.get(getattr(item, "originalname", ""))
        if n is not None and "contract" in item.path.parts:
            item.add_marker(pytest.mark.one_in(n))
