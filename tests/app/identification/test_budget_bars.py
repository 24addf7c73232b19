"""Bars of an uncertainty budget: shares, their order, and total and statistical part to two digits of the larger."""

import pytest

from app.identification.uncertainty_tables import BudgetBar, largest_sources

BARS = (
    BudgetBar("k2", 0.046, 0.0149, (("L", 0.6), ("noise", 0.3), ("others", 0.1))),
    BudgetBar("mu", 0.016, 0.0065, (("noise", 0.9), ("others", 0.1))),
)


def test_the_source_with_the_largest_shares_comes_first_and_the_others_last() -> None:
    assert largest_sources(BARS) == ("noise", "L", "others")


@pytest.mark.parametrize(
    ("total", "statistical", "text"),
    [
        (0.046, 0.0149, "4.6 %, statistical 1.5 %"),
        (0.00026, 0.00018, "0.026 %, statistical 0.018 %"),
        (0.6, 0.59, "60 %, statistical 59 %"),
        (12.0, 0.1, "1200 %, statistical 10 %"),
        (None, None, ""),
    ],
)
def test_both_uncertainties_have_two_digits_of_the_larger(
    total: float | None, statistical: float | None, text: str
) -> None:
    assert BudgetBar("k2", total, statistical, ()).size_text == text
