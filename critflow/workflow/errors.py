"""What can go wrong around a run, beyond the errors of the library."""

from critflow.result import CritflowError, IntegrityError


class LockedError(CritflowError):
    """Another run is at work in the folder."""


class Interrupted(CritflowError):
    """The run was asked to stop; everything computed so far is stored."""


class OtherTable(IntegrityError):
    """A whole shard of the case, but stored with another table of variables than the study has now."""


class ReportError(CritflowError):
    """A figure, the claims or the summary of a study could not be made; the data are safe."""
