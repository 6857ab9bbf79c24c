"""Tables of bad input: a call and a word of the sentence that it raises, by name."""

from functools import partial

import pytest

from critflow import CritflowError, InputError


def of_bounded_length(error, longest=300):
    """Whether an error is one sentence of at most this length, besides that critflow-extras has more."""
    sentence = str(error).partition(" (critflow-extras has more")[0]
    return "\n" not in str(error) and 10 < len(sentence) < longest


def refused(table, error=CritflowError):
    """A test of every row of a table: one sentence, no longer than three lines, that contains the word."""

    @pytest.mark.parametrize("name", table)
    def test(name):
        call, word = table[name]
        with pytest.raises(error, match=word) as caught:
            call()
        assert of_bounded_length(caught.value)

    return test


def refused_changes(call, *rows):
    """The same for rows of one call: its changed arguments and a word of the sentence."""
    table = {f"{word} {number}": (partial(call, **changes), word) for number, (changes, word) in enumerate(rows)}
    return refused(table, InputError)
