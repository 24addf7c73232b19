"""Facts that a message must carry, whatever its wording."""

import re


def assert_names(message: str, *facts: object) -> None:
    """Assert that a message has each fact: a number, a unit, or the name of a file, field or instrument, whole and not as a part.

    A fact is one word, for a phrase would be the message's wording, which only the test next to its code asserts.
    """
    for fact in map(str, facts):
        assert len(fact.split()) == 1, f"{fact!r} is wording, not a fact"
        whole = rf"(?<!\w)(?<!\d[.,]){re.escape(fact)}(?!\w)(?![.,]\d)"
        assert re.search(whole, message), f"{fact!r} is not in {message!r}"
