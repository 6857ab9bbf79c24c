"""Small runs of the studies."""

import small_studies
from small_studies_of_extras import SETTINGS
from study_runs import *  # noqa: F403

small_studies.SETTINGS |= SETTINGS
