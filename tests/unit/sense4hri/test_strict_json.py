"""JSON from outside is read whole or refused in one sentence, and what was read can be written."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sense4hri import strict_json
from sense4hri.errors import Refusal

TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"))
PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63) + 1, 2**63 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=8,
)


@given(PLAIN)
def test_what_can_be_stored_is_read_as_it_is(value: object) -> None:
    """Every value of UTF-8 without NUL, finite numbers of 64 bits and little depth comes back as it was."""
    assert strict_json.parse(json.dumps(value)) == value


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[" * 100_000, "nested deeper than 32 levels"),
        ("[" * 40 + "]" * 40, "nested deeper than 32 levels"),
        ('{"age": 1' + "0" * 400 + "}", "age is a whole number beyond 64 bits"),
        ('{"age": 1' + "0" * 5000 + "}", "not JSON"),
        ('{"a": {"b": NaN}}', "a.b is nan, which is no finite number"),
        ('{"rate": 1e999}', "rate is inf"),
        (r'{"name": "\ud800"}', "name holds half of a surrogate pair"),
        (r'{"\ud800": 1}', "metadata holds half of a surrogate pair"),
        (r'{"notes": ["", "a\u0000b"]}', "notes holds the character NUL"),
        (r'{"\u0000": 1}', "metadata holds the character NUL"),
        ('{"a": 1, "a": 2}', "'a' is given twice"),
        (b"\xff", "metadata is not JSON"),
        ("{", "metadata is not JSON"),
        (" " * (strict_json.MOST_BYTES + 1), "metadata is longer than 1048576 bytes"),
    ],
)
def test_what_a_program_behind_would_stumble_over_is_refused(text: str | bytes, sentence: str) -> None:
    """One sentence that can itself be written, and no other exception."""
    with pytest.raises(Refusal, match=sentence) as refused:
        strict_json.parse(text, "metadata")
    str(refused.value).encode()
    refused.value.field.encode()
