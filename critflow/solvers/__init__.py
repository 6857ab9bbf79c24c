"""Minimisers, cone programs and semidefinite programs: functions of vectors."""
