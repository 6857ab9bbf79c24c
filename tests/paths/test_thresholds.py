"""No threshold that decides `ok` is met by the luck of a processor: a part of the table of `tests/thresholds.py`."""

import pytest
from thresholds import MOST, SCENE, table


@pytest.mark.parametrize("group", SCENE, ids=lambda group: group.__name__)
def test_results_are_far_from_the_thresholds_that_decide_ok(group):
    ratios = table(4, 60, [group])
    assert ratios and all(len(reached) == 4 for reached in ratios.values())
    assert max(reached.max() for reached in ratios.values()) < MOST, ratios
