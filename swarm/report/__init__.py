"""The report: one self-contained HTML page of a run or a study, and what `swarm study` prints at its end."""
