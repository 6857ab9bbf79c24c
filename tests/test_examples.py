"""The examples in the docstrings of public functions run and print what they show."""

from example_checks import run_and_print_what_they_show, without_example

import critflow

test_the_examples_of_docstrings_run = run_and_print_what_they_show("critflow")


def test_every_public_function_has_an_example():
    assert without_example(critflow) == set()
