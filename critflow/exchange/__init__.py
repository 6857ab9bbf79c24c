"""Networks from and to other programs: one file a format, one record between all of them, one report of repairs."""
