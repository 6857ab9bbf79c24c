"""Small runs of the studies of the extras."""

import small_studies
import small_studies_of_extras
from study_runs import *  # noqa: F403

small_studies.SETTINGS.update(small_studies_of_extras.SETTINGS)
