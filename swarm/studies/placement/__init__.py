"""The places of lighthouse stations: candidates, the search, the judgement with a bound, and the files."""
