"""The layout of a craft's photodiodes: candidates on its hull, the search, the judgement, and the files."""
