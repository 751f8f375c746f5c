"""The sections of a run's page, one per file: each has `section(subject)`, which returns None where it says nothing."""
