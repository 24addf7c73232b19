"""Texts for property tests: of a sample of awkward characters in the quick tier, of all of Unicode in the deep one.

Hypothesis needs several seconds of processor time for its table of all characters, in every process.
"""

from typing import Any

from hypothesis import settings
from hypothesis import strategies as st

LETTERS = "aZxÉßµ²Ωж中٣07"
SIGNS = " _-+=.,;:/\\*?\"'|<>()[]{}@#%&~^`$°−…π∞\xa0\u200b\u202e\u2028\ufeff\ufffd\U0001f600\U0010ffff"
CONTROLS = "\0\t\n\r\x1b\x7f\x85"
SURROGATES = "\ud800\udfff"


def texts(sample: str = LETTERS + SIGNS + CONTROLS, every: st.SearchStrategy[str] | None = None, **sizes: Any) -> Any:
    """Texts of the characters of `sample` in the quick tier, else of `every` character (by default all that UTF-8 has)."""
    if settings.get_current_profile_name() == "quick":
        return st.text(st.sampled_from(sample), **sizes)
    return st.text(**sizes) if every is None else st.text(every, **sizes)
