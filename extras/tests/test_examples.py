"""The examples in the docstrings of public functions run and print what they show."""

from argument_checks import called_by_the_scene
from example_checks import run_and_print_what_they_show, without_example

import critflow_extras as ce

# Their examples are on pages of the documents.
ON_PAGES = {"bond_operator", "design", "geometric_split", "hookean_split", "pareto", "prune_towards"}

test_the_examples_of_docstrings_run = run_and_print_what_they_show("critflow_extras")


def test_every_public_function_has_an_example():
    assert without_example(ce) - called_by_the_scene() <= ON_PAGES
